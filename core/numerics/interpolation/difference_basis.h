// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"

namespace deform {

/// Differences between neighbouring centres in place of the values at centres that are close to another one: (T f)_i = f_i - f_p
/// where the parent p is the nearest of the centres that come before i in the farthest-point order, and f_i for centres farther
/// than `close` from all before. T is unit lower triangular in that order. Kernel matrices of smooth kernels lose as many digits
/// as the cube of the distance has, and more, since the rows of close centres are nearly alike; those of differences, which are
/// derivatives up to a factor, lose about as many as the distance itself (compare the samplets of Harbrecht and Multerer,
/// J. Comput. Phys. 471, 2022, which are differences of higher order). Immutable; any thread.
class DifferenceBasis {
 public:
  static constexpr double close = 1e-2;  ///< in units of the size of all centres, which should be one
  static constexpr std::uint32_t none = 0xffffffff;

  /// Takes O(m^2) time. Throws Error(cancelled), deadline_exceeded.
  DifferenceBasis(std::span<const Vec3> centres, const RunContext& context);

  /// The parent of each centre, or none.
  const std::vector<std::uint32_t>& parents() const { return parents_; }
  /// How many centres have a parent.
  std::size_t size() const { return order_.size(); }
  std::size_t bytes() const { return (parents_.size() + order_.size()) * sizeof(std::uint32_t); }

  /// Replaces the first m rows of F by T F. Differences of values that are alike are exact.
  void apply(Eigen::MatrixXd& F) const;
  /// Replaces the first m rows of W by T^T W: weights of centres from those of differences.
  void apply_transposed(Eigen::MatrixXd& W) const;

 private:
  std::vector<std::uint32_t> parents_;
  std::vector<std::uint32_t> order_;  ///< centres with a parent, parents before children
};

}  // namespace deform
