// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <vector>

namespace deform::cad {

/// The interpolant by r^2 log r and {x, y, 1} of values at places in the plane (thesis 6.2). Immutable.
class ThinPlate {
 public:
  ThinPlate() = default;  ///< 0 everywhere
  /// centres: at least three, no two alike, not on one line; values: a row for each.
  ThinPlate(std::vector<Eigen::Vector2d> centres, const Eigen::MatrixXd& values);

  bool is_zero() const { return centres_.empty(); }
  /// A value for each column; 0 columns where it is zero.
  Eigen::RowVectorXd operator()(const Eigen::Vector2d& x) const;
  /// The derivatives of these by x and y, 2 rows.
  Eigen::Matrix2Xd gradient(const Eigen::Vector2d& x) const;

 private:
  std::vector<Eigen::Vector2d> centres_;
  Eigen::MatrixXd weights_;  ///< n + 3 rows
};

}  // namespace deform::cad
