// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "tests/core/deformers/dense_constraints.h"

/// Points on several shapes at once by augmented Lagrangians (Hestenes 1969, Powell 1969) in the points and the parameters of the
/// shapes, in extended precision: redundant conditions, such as those of a circle in the plane of its rim, need no ranks there.
namespace deform::test::dense_energy {

/// One exact constraint.
struct PlacedSet {
  Set set;                          ///< its kind and its rest; no rows
  std::vector<std::size_t> places;  ///< its points among all
  /// For a cylinder: positions in `places` of circles on it, which are sections across its axis (five points of a circle on a
  /// cylinder are one), though no distance tells that to first order.
  std::vector<std::vector<std::size_t>> sections;

  Places of(const Places& all) const;
  Extended distance(const Places& all) const;
};

/// A shape by its parameters, and what points are off it: values and their derivatives by points and by parameters.
class Shape {
 public:
  struct Row {
    std::size_t point;
    Extended value;
    Place by_point;
    std::vector<Extended> by_parameters;
  };

  /// That of a set nearest to its points.
  Shape(const PlacedSet& of, const Places& y);

  std::size_t parameters() const;

  std::vector<Row> rows(const Places& y) const;

  void change(const std::vector<Extended>& by);

 private:
  bool is_round() const { return dense_energy::is_round(kind_); }
  /// The parameters before those of heights along the axis: of the centre and the axis across it, radius and angle where free.
  std::size_t first_height() const { return 4 + (round_.free_radius() ? 1 : 0) + (round_.free_angle() ? 1 : 0); }
  /// The rotation of the rest, from where it has been turned to.
  Eigen::Matrix<Extended, 3, 3> turned(const Places& on) const;

  const PlacedSet& of_;
  const ConstraintKind kind_;
  const RoundKind round_;
  Place centre_, axis_ = Place::UnitZ();
  Extended radius_ = 0, angle_ = 0;
  std::vector<Extended> heights_;  ///< of the sections
  Eigen::Matrix<Extended, 3, 3> turn_ = Eigen::Matrix<Extended, 3, 3>::Identity();
};

/// min sum |y - x|^2 over the y on the shapes, where some points stay.
class Placement {
 public:
  Placement(const std::vector<PlacedSet>& sets, const Places& x, const std::vector<bool>& moves);

  struct Solution {
    Places y;               ///< empty if the steps do not end
    Extended rounding = 0;  ///< the last step
  };

  /// The solution next to `y`.
  Solution near(Places y);

 private:
  Matrix residuals(const Places& y, Matrix* slopes = nullptr) const;
  Eigen::Index points_end() const { return static_cast<Eigen::Index>(3 * moving_.size()); }

  /// Minimizes |y - x|^2 + weight sum (residual + f / weight)^2 and updates the forces. False if it does not end.
  bool run(Places& y);

  const std::vector<PlacedSet>& sets_;
  const Places& x_;
  std::vector<Shape> shapes_;
  std::vector<std::size_t> moving_;
  std::vector<Eigen::Index> place_;  ///< of each point among the moving ones, or -1
  std::vector<Extended> forces_;
  Extended size_ = 0;
};

/// Values at places of the biharmonic interpolant, with constants, of steps at centres.
Places carried(const Places& centres, const Places& steps, const Places& at);

}  // namespace deform::test::dense_energy
