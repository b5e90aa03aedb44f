// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <deque>
#include <vector>

#include "core/base/types.h"

namespace deform {

/// Anderson acceleration of a fixed-point iteration p <- q(p) (Anderson 1965; Walker and Ni 2011): the next p is q minus the
/// combination of the last changes of q for which the same combination of the changes of q - p comes nearest to q - p.
class Anderson {
 public:
  static constexpr std::size_t window = 5;

  void clear();
  std::size_t size() const { return q_changes_.size(); }

  /// Takes the pair of the last step; returns the largest ratio of a change of q to that of p in the window: how fast the plain
  /// iteration contracts (0 before there is a change).
  double add(const std::vector<Vec3>& p, const std::vector<Vec3>& q);
  /// The accelerated p.
  std::vector<Vec3> next() const;

 private:
  Eigen::VectorXd p_, q_;  ///< of the last step
  std::deque<Eigen::VectorXd> q_changes_, f_changes_;
  std::deque<double> ratios_;
};

}  // namespace deform
