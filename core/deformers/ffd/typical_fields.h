// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/base/types.h"
#include "core/deformers/handles/handle_motion.h"

namespace deform {

/// The held points of direct manipulation and what moves them.
struct HeldHandles {
  const Mesh& mesh;
  const Setup& setup;
  const std::vector<RegionIndex>& region_of;  ///< n
  const std::vector<PointId>& ids;            ///< m: handle and fixed points
  const std::vector<HandleFrame>& frames;     ///< H
  const UnitBox& box;
};

/// The motions that an automatic clamp is to meet (HeldInverse::Typical::fields), m x at most 4H: the fields 1, x, y and z of
/// each handle, in unit coordinates. Handles that the same variables drive count as one, as they never move apart: a handle on
/// both sides of a symmetry plane is then the same as its half and the image of that. Where the variables move handles of such a
/// group by different maps, components of their rates at rest and of the change of these with the motion (which differ for
/// rotations only) are added, less what the fields of the group contain. Throws what handle_motion_derivative() throws.
Eigen::MatrixXd typical_fields(const HeldHandles& of);

}  // namespace deform
