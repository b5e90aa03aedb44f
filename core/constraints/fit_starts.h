// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <array>
#include <span>
#include <vector>

#include "core/base/types.h"
#include "core/constraints/fitting.h"

// Starting points of the nonlinear fits: closed forms and searches that use algebraic distances.

namespace deform {

/// Mean and principal axes of a set of points.
struct PrincipalAxes {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();  ///< columns, right-handed, by ascending moment
  Eigen::Vector3d moments = Eigen::Vector3d::Zero();   ///< sums of squares along the axes
};
PrincipalAxes principal_axes(std::span<const Vec3> x);

/// A right-handed frame (columns) with its z axis along the unit vector `z` and its x axis as close to `x` as possible; arbitrary
/// if x is parallel to z.
Eigen::Matrix3d axes_from(const Eigen::Vector3d& z, const Eigen::Vector3d& x);

/// A unit vector perpendicular to the unit vector n.
Eigen::Vector3d any_normal_to(const Eigen::Vector3d& n);

/// Evenly chosen points: all if there are fewer than twice `count`, otherwise at least `count` and less than twice as many.
std::vector<Eigen::Vector3d> thinned(std::span<const Vec3> x, std::size_t count);

/// The algebraic least-squares circle x^2 + y^2 = 2 a x + 2 b y + c through points in a plane (Kasa); radius 0 if there is none.
struct PlaneCircle {
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  double radius = 0;
};
PlaneCircle algebraic_circle(const std::vector<Eigen::Vector2d>& points);

/// The algebraic least-squares sphere, in the same way.
struct AlgebraicSphere {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  double radius = 0;
};
AlgebraicSphere algebraic_sphere(const std::vector<Eigen::Vector3d>& points);

/// The second fundamental form H of a patch: the fit of z = c + slope . (x, y) + 1/2 (x, y) H (x, y) in principal axes, where x
/// and y are columns 2 and 1 of the axes and z is column 0, the axis of least moment.
Eigen::Matrix2d patch_curvature(std::span<const Vec3> x, const PrincipalAxes& axes);

/// About `count` evenly distributed directions on a hemisphere (Fibonacci), followed by the three principal axes.
std::vector<Eigen::Vector3d> directions(int count, const PrincipalAxes& axes);

/// A cylinder or cone about an axis, from the algebraic fit for a given direction.
struct AxisCandidate {
  Eigen::Vector3d direction = Eigen::Vector3d::UnitZ();
  Eigen::Vector3d point = Eigen::Vector3d::Zero();  ///< point of the axis at the height of the mean of the points
  double radius = 0;                                ///< at `point`
  double slope = 0;                                 ///< derivative of the radius along the axis
  double energy = 0;                                ///< mean squared error per point
};
enum class Profile { cylinder, cone };
std::vector<AxisCandidate> axis_candidates(std::span<const Vec3> x, Profile profile, std::size_t count);

}  // namespace deform
