// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <string>

#include "core/deformers/setup.h"
#include "deform/v1/geometry.pb.h"
#include "deform/v1/setup.pb.h"

namespace deform::convert {

/// The setup that a message describes; geometry is not looked at. Throws Error(invalid_argument) with the path of the field
/// ("handles[2].region.box.min: expected 3 numbers, got 2"): wrong number of coordinates, non-finite coordinates, no or
/// several kinds of a region or variable, unknown enum values, nesting deeper than 64, more than max_handles handles. What the
/// values mean, their limits first of all, is checked by deform::validate().
Setup setup_from_proto(const v1::Setup& message, std::size_t max_handles);

/// The same, with what is found going to `problems`. Collecting, an entry that cannot be read stands in the setup as a default of
/// its type, so that indices agree; too many entries are an Error all the same.
Setup setup_from_proto(const v1::Setup& message, std::size_t max_handles, Problems& problems);

/// The same setup with the kernel named that an rbf without one has for this geometry.
v1::Setup with_kernel(v1::Setup message, const v1::GeometryInfo& geometry);

/// The same setup with defaults filled in and id lists sorted, so that messages that mean the same have the same id. The message
/// must have passed setup_from_proto().
v1::Setup canonical_setup(const v1::Setup& message, const std::string& geometry_id);

/// SHA-256 of "deform.setup.1\0" and the deterministic serialization of a canonical setup.
std::string system_id(const v1::Setup& canonical);

}  // namespace deform::convert
