// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <vector>

#include "core/base/types.h"

namespace deform::bench {

/// LU (dgetrf) of the bordered system of r^3 with linear polynomials, to compare the solvers with.
class BorderedLu {
 public:
  explicit BorderedLu(std::span<const Vec3> centres);

  std::size_t bytes() const { return static_cast<std::size_t>(A_.size()) * sizeof(double) + pivots_.size() * sizeof(int); }
  /// Values at the centres (m x columns) to weights and coefficients of the polynomials.
  Eigen::MatrixXd solve(const Eigen::MatrixXd& F) const;

 private:
  Eigen::MatrixXd A_;
  std::vector<int> pivots_;
};

}  // namespace deform::bench
