// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <array>
#include <set>
#include <vector>

namespace deform::cad {

/// Nodes along one parameter, and the cubic spline that interpolates values at them: C2 between two breaks (not-a-knot),
/// continuous at the breaks. It has as many control points as nodes.
class SplineAxis {
 public:
  /// breaks: ascending, at least two; each stretch between two of them starts with three equal intervals.
  explicit SplineAxis(const std::vector<double>& breaks);

  const std::vector<double>& nodes() const { return nodes_; }
  int interval_of(double t) const;  ///< the number of its first node; beyond the ends the first or last one
  /// Halves intervals, and neighbours of the same stretch that are more than twice as long then. Returns false and does nothing
  /// where there would be more than 250 nodes, or one of these intervals is shorter than 1/4000 of its stretch.
  bool halve(const std::set<int>& intervals);

  /// Parameters where a fit is checked, ascending: all dyadic points inside the intervals that lie at most as far apart as
  /// `spacing`, of each interval at least the middle. Those that become nodes by halve() have the same bits then.
  std::vector<double> checks(double spacing) const;

  /// Rows of control points from rows of values at the nodes.
  Eigen::MatrixXd poles(const Eigen::MatrixXd& values) const;
  /// Rows of values of the spline at ascending parameters from rows of control points.
  Eigen::MatrixXd values(const Eigen::MatrixXd& poles, const std::vector<double>& at) const;

  /// The four cubic functions that are not 0 at t, and the number of the control point of the first.
  int functions(double t, std::array<double, 4>& values) const;

  std::vector<double> knots() const;  ///< distinct
  std::vector<int> multiplicities() const;

 private:
  int stretches() const { return static_cast<int>(first_.size()) - 1; }
  int stretch_of(int interval) const;

  std::vector<double> nodes_;
  std::vector<int> first_;  ///< node at which each stretch starts, and the last node
};

}  // namespace deform::cad
