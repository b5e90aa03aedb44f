// SPDX-License-Identifier: GPL-3.0-or-later
// LDL^T of the bordered matrix by LAPACK (dsytrf), kept as a packed triangle.
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/numerics/dense/condition.h"
#include "core/numerics/dense/lapack.h"
#include "core/numerics/interpolation/difference_basis.h"
#include "core/numerics/interpolation/saddle_factor.h"
#include "core/numerics/kernels/residual.h"
#include "core/numerics/kernels/tiles.h"

namespace deform {

namespace {

using Eigen::MatrixXd;

// The full symmetric bordered matrix, column-major, and its 1-norm.
std::vector<double> bordered_matrix(const SaddleProblem& problem, const RunContext& context, double& norm1) {
  const std::size_t m = problem.centres.size();
  const std::size_t q = problem.polynomials.terms();
  const std::size_t n = m + q;
  std::vector<double> A(n * n);
  const TiledPoints tiled(problem.centres);
  constexpr std::size_t columns = 64;
  std::vector<double> sums(n, 0.0);
  const MatrixXd P = problem.polynomials.matrix(problem.centres);
  parallel_for(context, m, columns, [&](std::size_t begin, std::size_t end) {
    std::vector<double> block((end - begin) * tile_size);
    for (std::size_t t = 0; t < tiled.tiles(); ++t) {
      tile_kernel(problem.kernel, tiled.tile(t), problem.centres.subspan(begin, end - begin), block.data());
      const std::size_t first = t * tile_size;
      const std::size_t count = std::min(tile_size, m - first);
      for (std::size_t j = begin; j < end; ++j) {
        std::copy_n(block.data() + (j - begin) * tile_size, count, A.data() + j * n + first);
      }
    }
    for (std::size_t j = begin; j < end; ++j) {
      for (std::size_t t = 0; t < q; ++t) A[j * n + m + t] = P(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(t));
      for (std::size_t i = 0; i < n; ++i) sums[j] += std::abs(A[j * n + i]);
    }
    context.progress("assemble", static_cast<double>(end) / static_cast<double>(m));
  });
  for (std::size_t t = 0; t < q; ++t) {
    for (std::size_t i = 0; i < m; ++i) {
      A[(m + t) * n + i] = P(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(t));
      sums[m + t] += std::abs(A[(m + t) * n + i]);
    }
  }
  norm1 = sums.empty() ? 0 : *std::max_element(sums.begin(), sums.end());
  return A;
}

// The same of T Phi T^T and T P, without its norm.
std::vector<double> differenced_matrix(const SaddleProblem& problem, const DifferenceBasis& basis, const RunContext& context) {
  const std::size_t m = problem.centres.size();
  const std::size_t q = problem.polynomials.terms();
  const std::size_t n = m + q;
  const std::vector<std::uint32_t>& parents = basis.parents();
  std::vector<double> A(n * n);
  const TiledPoints tiled(problem.centres);
  MatrixXd P = problem.polynomials.matrix(problem.centres);
  basis.apply(P);
  parallel_for(context, m, 8, [&](std::size_t begin, std::size_t end) {
    std::vector<double> high(tiled.tiles() * tile_size), low(high.size());
    for (std::size_t j = begin; j < end; ++j) {
      const Vec3* other = parents[j] == DifferenceBasis::none ? nullptr : &problem.centres[parents[j]];
      accurate_column(problem.kernel, tiled, problem.centres[j], other, high.data(), low.data());
      double* column = A.data() + j * n;
      for (std::size_t i = 0; i < m; ++i) {
        const std::uint32_t p = parents[i];
        column[i] = p == DifferenceBasis::none ? high[i] : (high[i] - high[p]) + (low[i] - low[p]);
      }
      for (std::size_t t = 0; t < q; ++t) {
        A[(m + t) * n + j] = column[m + t] = P(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(t));
      }
    }
    context.progress("assemble", static_cast<double>(end) / static_cast<double>(m));
  });
  return A;
}

// Powers of two s such that the largest entry of each row of S A S is near one (Ruiz 2001). Replaces A by that, and sets its
// 1-norm.
Eigen::VectorXd equilibrate(std::vector<double>& A, const RunContext& context, double& norm1) {
  constexpr int passes = 6;
  const auto n = static_cast<Eigen::Index>(std::lround(std::sqrt(static_cast<double>(A.size()))));
  Eigen::Map<MatrixXd> matrix(A.data(), n, n);
  Eigen::VectorXd scale = Eigen::VectorXd::Ones(n), change(n);
  const auto columns = static_cast<std::size_t>(n);
  for (int pass = 0; pass < passes; ++pass) {
    parallel_for(context, columns, 8, [&](std::size_t begin, std::size_t end) {
      for (auto j = static_cast<Eigen::Index>(begin); j < static_cast<Eigen::Index>(end); ++j) {
        const double largest = scale[j] * matrix.col(j).cwiseAbs().cwiseProduct(scale).maxCoeff();
        change[j] = largest > 0 ? std::exp2(-std::round(std::log2(largest) / 2)) : 1;
      }
    });
    scale = scale.cwiseProduct(change);
  }
  parallel_for(context, columns, 8, [&](std::size_t begin, std::size_t end) {
    for (auto j = static_cast<Eigen::Index>(begin); j < static_cast<Eigen::Index>(end); ++j) {
      matrix.col(j) = scale[j] * matrix.col(j).cwiseProduct(scale);
      change[j] = matrix.col(j).cwiseAbs().sum();
    }
  });
  norm1 = n > 0 ? change.maxCoeff() : 0;
  return scale;
}

class Ldlt final : public SaddleFactor {
 public:
  Ldlt(const SaddleProblem& problem, const RunContext& context) {
    double norm1 = 0;
    values_ = bordered_matrix(problem, context, norm1);
    factor(problem, context, norm1);
  }
  Ldlt(const SaddleProblem& problem, DifferenceBasis differences, const RunContext& context) : basis_(std::move(differences)) {
    double norm1 = 0;
    values_ = differenced_matrix(problem, *basis_, context);
    scale_ = equilibrate(values_, context, norm1);
    factor(problem, context, norm1);
  }

  double condition() const override { return condition_; }
  std::size_t bytes() const override {
    return values_.size() * sizeof(double) + pivots_.size() * sizeof(int) +
           static_cast<std::size_t>(scale_.size()) * sizeof(double) + (basis_ ? basis_->bytes() : 0);
  }

  void solve(MatrixXd& B) const override {
    if (!basis_) return solve_factored(B);
    basis_->apply(B);
    B.array().colwise() *= scale_.array();
    solve_factored(B);
    B.array().colwise() *= scale_.array();
    basis_->apply_transposed(B);
  }

 private:
  void factor(const SaddleProblem& problem, const RunContext& context, double norm1) {
    lapack::use_one_thread();
    const int n = static_cast<int>(problem.centres.size() + problem.polynomials.terms());
    pivots_.resize(static_cast<std::size_t>(n));
    const int lwork = 64 * n;
    std::vector<double> work(static_cast<std::size_t>(lwork));
    int info = 0;
    context.progress("factor", 0);
    dsytrf_("L", &n, values_.data(), &n, pivots_.data(), work.data(), &lwork, &info);
    if (info > 0) {
      throw Error(ErrorCode::numerical_failure, "the RBF system is singular: pivot " + std::to_string(info) +
                                                    " is zero; centres coincide or the shape parameter is too large");
    }
    context.check();
    pack(static_cast<std::size_t>(n));
    condition_ = norm1 * inverse_norm1(n, [&](Eigen::VectorXd& x) {
                   context.check();
                   MatrixXd B = x;
                   solve_factored(B);
                   x = B.col(0);
                 });
    context.progress("factor", 1);
  }

  void solve_factored(MatrixXd& B) const {
    const int n = static_cast<int>(pivots_.size());
    const int columns = static_cast<int>(B.cols());
    int info = 0;
    dsptrs_("L", &n, &columns, values_.data(), pivots_.data(), B.data(), &n, &info);
  }

  // The lower triangle, column after column, moved to the front in place: dsptrs reads the same factors as dsytrs.
  void pack(std::size_t n) {
    std::size_t to = 0;
    for (std::size_t j = 0; j < n; ++j) {
      for (std::size_t i = j; i < n; ++i) values_[to++] = values_[j * n + i];
    }
    values_.resize(to);
    values_.shrink_to_fit();
  }

  std::vector<double> values_;
  std::vector<int> pivots_;
  double condition_ = 0;
  std::optional<DifferenceBasis> basis_;
  Eigen::VectorXd scale_;  ///< of rows and columns, with a basis
};

}  // namespace

std::unique_ptr<SaddleFactor> factor_ldlt(const SaddleProblem& problem, const RunContext& context) {
  return std::make_unique<Ldlt>(problem, context);
}

std::unique_ptr<SaddleFactor> factor_differences(const SaddleProblem& problem, const RunContext& context) {
  return std::make_unique<Ldlt>(problem, DifferenceBasis(problem.centres, context), context);
}

}  // namespace deform
