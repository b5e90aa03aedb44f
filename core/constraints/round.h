// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "core/base/types.h"
#include "core/constraints/fitting.h"

namespace deform {

/// The signed distance from a sphere or cylinder through the origin with normal x there and curvature k: its centre (or axis) is
/// at -x / k, and k = 0 is the plane (Lukacs, Marshall, Martin 1998). This form does not degenerate for nearly flat shapes, and a
/// change of sign of k only moves the centre to the other side. With q = |M y|^2, where M projects out the direction of an axis,
/// the distance s satisfies k s^2 + 2 s = k q + 2 x.
struct RoundDistance {
  double value = 0;
  double ratio = 1;  ///< 1 + k s = distance from the centre over the radius, >= 0
  Eigen::Vector3d normal = Eigen::Vector3d::UnitX();
  Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();  ///< second derivatives of the value with respect to y
  double by_curvature = 0, by_curvature_twice = 0;
  Eigen::Vector3d normal_by_curvature = Eigen::Vector3d::Zero();
};
enum class About { point, z_axis };
RoundDistance round_distance(const Eigen::Vector3d& y, double curvature, About about);

/// A round shape through `origin` with this normal (x axis of the frame) and curvature (size 0); the z axis of the frame is as
/// close to `z` as possible.
Fit<1> touching(const Eigen::Vector3d& origin, const Eigen::Vector3d& normal, const Eigen::Vector3d& z, double curvature);
/// A round shape with this centre and radius, whose frame lies on the side of `towards`. z is the unit axis (any direction for
/// a sphere).
Fit<1> centred(const Eigen::Vector3d& centre, double radius, const Eigen::Vector3d& z, const Eigen::Vector3d& towards);

/// Turns starts of fits with free curvature into starts with the given curvature, on both sides.
std::vector<Fit<1>> with_curvature(const std::vector<Fit<1>>& starts, double curvature);

}  // namespace deform
