// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "core/deformers/setup.h"
#include "deform/v1/geometry.pb.h"
#include "deform/v1/setup.pb.h"

namespace deform::convert {

/// Converts a method; an empty message means rbf with its defaults. Throws Error(invalid_argument) with the path of the field,
/// see setup.h.
MethodOptions method_from_proto(const v1::Method& message);
/// The same, adding errors to `problems`, each under the path of its option. Options that cannot be converted keep their
/// defaults.
MethodOptions method_from_proto(const v1::Method& message, Problems& problems);

/// Sets the kernel of an rbf method without one from the bounding box of the geometry (default_kernel() of core).
void set_default_kernel(v1::Method& message, const v1::GeometryInfo& geometry);

/// Fills in defaults and drops fields that the method ignores.
void canonicalize_method(v1::Method& message);

}  // namespace deform::convert
