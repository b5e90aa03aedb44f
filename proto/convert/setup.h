// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <string>

#include "core/deformers/setup.h"
#include "deform/v1/geometry.pb.h"
#include "deform/v1/setup.pb.h"

namespace deform::convert {

/// Converts a setup, without its geometry. Throws Error(invalid_argument) with the path of the field ("handles[2].region.box.min:
/// expected 3 numbers, got 2"): wrong number of coordinates, non-finite coordinates, no or several kinds of a region or variable,
/// unknown enum values, nesting deeper than 64, more than max_handles handles. The meaning and the limits of values are checked
/// by deform::validate().
Setup setup_from_proto(const v1::Setup& message, std::size_t max_handles);

/// The same, adding errors to `problems`. In collecting mode an entry that cannot be converted is default-constructed in the
/// setup, so that indices agree; too many entries are still an Error.
Setup setup_from_proto(const v1::Setup& message, std::size_t max_handles, Problems& problems);

/// The same setup, in which an rbf method without a kernel has the default one for this geometry.
v1::Setup with_kernel(v1::Setup message, const v1::GeometryInfo& geometry);

/// The same setup with defaults filled in and id lists sorted, so that equivalent messages have the same id. The message must
/// have passed setup_from_proto().
v1::Setup canonical_setup(const v1::Setup& message, const std::string& geometry_id);

/// SHA-256 of "deform.setup.1\0" and the deterministic serialization of a canonical setup.
std::string system_id(const v1::Setup& canonical);

}  // namespace deform::convert
