// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "core/base/types.h"
#include "core/constraints/fitting.h"

namespace deform {

/// Signed distance from a round shape that touches the origin with the normal x there and the curvature k: its centre (or axis)
/// is at -x / k, and k = 0 is the plane (Lukacs, Marshall, Martin 1998). In this form nothing degenerates when the shape is
/// nearly flat, and a change of sign only turns it to the other side. With q = |M y|^2, M the projection that leaves out the
/// direction of an axis, the distance s satisfies k s^2 + 2 s = k q + 2 x.
struct RoundDistance {
  double value = 0;
  double ratio = 1;  ///< 1 + k s = distance from the centre over the radius, >= 0
  Eigen::Vector3d normal = Eigen::Vector3d::UnitX();
  Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();  ///< of the value, with respect to y
  double by_curvature = 0, by_curvature_twice = 0;
  Eigen::Vector3d normal_by_curvature = Eigen::Vector3d::Zero();
};
enum class About { point, z_axis };
RoundDistance round_distance(const Eigen::Vector3d& y, double curvature, About about);

/// Size 0 of round shapes is the curvature. What touches at `origin`: normal x, z as near to `z` as can be.
Fit<1> touching(const Eigen::Vector3d& origin, const Eigen::Vector3d& normal, const Eigen::Vector3d& z, double curvature);
/// What has its centre there, touched on the side of `towards`; z: unit length, the axis (any direction for a sphere).
Fit<1> centred(const Eigen::Vector3d& centre, double radius, const Eigen::Vector3d& z, const Eigen::Vector3d& towards);

/// Starts of fits with a free curvature -> starts with the given one, on both sides.
std::vector<Fit<1>> with_curvature(const std::vector<Fit<1>>& starts, double curvature);

}  // namespace deform
