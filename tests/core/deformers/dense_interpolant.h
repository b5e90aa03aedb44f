// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "core/numerics/kernels/kernel.h"
#include "tests/core/deformers/wide.h"
#include "tests/support/linear_algebra.h"

namespace deform::test {

/// Radial basis functions by their formulas (thesis table 3.1) and dense linear algebra, in double-double: LU in double, or in
/// extended precision or double-double where that does not lead to the solution, with refinement whose residuals have 106 bits.
class DenseInterpolant {
 public:
  struct Problem {
    Kernel kernel = Kernel::triharmonic;
    Wide shape = 1;  ///< model units
    int degree = 1;
    bool flat = false;             ///< all points have the same z: no monomials with it
    std::vector<WideVec> centres;  ///< model units
  };

  explicit DenseInterpolant(Problem problem);

  std::size_t terms() const { return size_ - places_.size(); }

  /// Solves for these values at the centres; whether that succeeded.
  bool solve(const std::vector<WideVec>& data);

  WideVec value(const WideVec& x) const;

 private:
  using Extended = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;

  Wide& at(std::size_t i, std::size_t j) { return matrix_[i * size_ + j]; }
  WideVec place(const WideVec& x) const;
  Wide phi(const WideVec& between) const;
  std::vector<Wide> monomials(const WideVec& x) const;

  void factor(int stage);

  std::vector<WideVec> solved(int stage, const std::vector<WideVec>& r) const;

  static double largest(const std::vector<WideVec>& x);

  /// Whether the residual shrinks to the rounding of its own sums. Its equations are then met with ten digits more than any
  /// solution in double precision could meet them, which is what counts for values, whatever the condition makes of the weights.
  bool refine(int stage);

  const Problem problem_;
  Vec3 origin_{};
  double unit_ = 1;
  std::vector<WideVec> places_;
  std::size_t size_ = 0;
  std::vector<Wide> matrix_;
  std::vector<WideVec> right_, solution_;
  int stage_ = 0, factored_ = -1;
  std::vector<double> doubles_;
  std::vector<int> pivots_;
  Lu<long double> extended_;
  std::vector<Wide> wides_;
  std::vector<std::size_t> rows_;
};

}  // namespace deform::test
