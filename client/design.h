// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>

#include "core/base/types.h"
#include "deform/v1/deformation.pb.h"

namespace deform::client {

/// A design as one value per design variable of the setup, in its order.
v1::Design variables_design(std::span<const double> values);

/// x' = A x + b for all points of a handle.
v1::Motion affine_motion(const std::string& handle, const Affine& map);

/// A displacement per point of a handle, in the order of its ascending point ids. Model units.
v1::Motion displacement_motion(const std::string& handle, std::span<const Vec3> displacements);

}  // namespace deform::client
