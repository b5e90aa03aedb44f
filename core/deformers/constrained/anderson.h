// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <deque>
#include <vector>

#include "core/base/types.h"

namespace deform {

/// Anderson acceleration of a fixed-point iteration p <- q(p) (Anderson 1965; Walker and Ni 2011): the next p is q minus the
/// linear combination of the last changes of q whose coefficients fit the changes of q - p to q - p in the least-squares sense.
class Anderson {
 public:
  static constexpr std::size_t window = 5;

  void clear();
  std::size_t size() const { return q_changes_.size(); }

  /// Adds the pair of the last step. Returns the largest ratio of a change of q to that of p in the window, an estimate of the
  /// contraction rate of the plain iteration; 0 after the first step.
  double add(const std::vector<Vec3>& p, const std::vector<Vec3>& q);
  /// The accelerated p.
  std::vector<Vec3> next() const;

 private:
  Eigen::VectorXd p_, q_;  ///< pair of the previous step
  std::deque<Eigen::VectorXd> q_changes_, f_changes_;
  std::deque<double> ratios_;
};

}  // namespace deform
