// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <array>
#include <span>
#include <vector>

#include "core/base/types.h"
#include "core/constraints/fitting.h"

// Where the fits start: closed forms and searches on algebraic distances. None of them is the result.

namespace deform {

/// Mean and principal axes of a set.
struct PrincipalAxes {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();  ///< columns, right-handed, of ascending moment
  Eigen::Vector3d moments = Eigen::Vector3d::Zero();   ///< sums of squares along the axes
};
PrincipalAxes principal_axes(std::span<const Vec3> x);

/// Right-handed, z along `z` and x as near to `x` as can be (any direction when x is along z). z: unit length.
Eigen::Matrix3d axes_from(const Eigen::Vector3d& z, const Eigen::Vector3d& x);

/// A unit vector at right angles to a unit vector.
Eigen::Vector3d any_normal_to(const Eigen::Vector3d& n);

/// At most `count` of the points, evenly taken.
std::vector<Eigen::Vector3d> thinned(std::span<const Vec3> x, std::size_t count);

/// A least-squares circle x^2 + y^2 = 2 a x + 2 b y + c through points of a plane (Kasa); radius 0 when there is none.
struct PlaneCircle {
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  double radius = 0;
};
PlaneCircle algebraic_circle(const std::vector<Eigen::Vector2d>& points);

/// A sphere in the same way.
struct AlgebraicSphere {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  double radius = 0;
};
AlgebraicSphere algebraic_sphere(const std::vector<Eigen::Vector3d>& points);

/// Second fundamental form of a patch over its plane: z = c + slope . (x, y) + 1/2 (x, y) H (x, y), in principal axes with z
/// along the least one. x and y are columns 2 and 1 of the axes, z column 0.
Eigen::Matrix2d patch_curvature(std::span<const Vec3> x, const PrincipalAxes& axes);

/// Directions of half a sphere, about `count` of them, evenly spread (Fibonacci); then the three principal axes.
std::vector<Eigen::Vector3d> directions(int count, const PrincipalAxes& axes);

/// Round surfaces about an axis with a straight profile, by the algebraic fit for every direction: the best few.
struct AxisCandidate {
  Eigen::Vector3d direction = Eigen::Vector3d::UnitZ();
  Eigen::Vector3d point = Eigen::Vector3d::Zero();  ///< of the axis, level with the mean of the points
  double radius = 0;                                ///< there
  double slope = 0;                                 ///< of the radius along the axis
  double energy = 0;                                ///< per point
};
enum class Profile { cylinder, cone };
std::vector<AxisCandidate> axis_candidates(std::span<const Vec3> x, Profile profile, std::size_t count);

}  // namespace deform
