// SPDX-License-Identifier: GPL-3.0-or-later
// Cholesky on the complement of the polynomials (null-space method). With P = Q [R; 0], w = Q [w1; w2] and A = sign * Phi:
//   R^T w1 = g,   K22 w2 = s f2 - K21 w1,   R c s = s f1 - K11 w1 - K12 w2,   K = Q^T A Q,
// where K22 is positive definite. Q = I - V T V^T (Householder), so K = A - Z V^T - V Z^T with Z = W - V S / 2, W = A V T and
// S = T^T V^T W: two rank-q updates while the panels are assembled, and no second m x m matrix.
#include <algorithm>
#include <limits>

#include "core/base/parallel.h"
#include "core/numerics/dense/condition.h"
#include "core/numerics/dense/decompositions.h"
#include "core/numerics/dense/lapack.h"
#include "core/numerics/dense/packed_cholesky.h"
#include "core/numerics/interpolation/saddle_factor.h"
#include "core/numerics/kernels/tiles.h"

namespace deform {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

class ProjectedCholesky : public SaddleFactor {
 public:
  ProjectedCholesky(const SaddleProblem& problem, const RunContext& context);
  bool factor(const RunContext& context);

  void solve(MatrixXd& B) const override;
  std::size_t bytes() const override {
    return packed_.bytes() + sizeof(double) * static_cast<std::size_t>(V_.size() + T_.size() + R_.size() + K1_.size());
  }
  double condition() const override { return condition_; }

 private:
  void project(const SaddleProblem& problem, const RunContext& context, MatrixXd& Z);
  void assemble_panel(const SaddleProblem& problem, const MatrixXd& Z, std::size_t panel);
  void assemble_top(const SaddleProblem& problem, const MatrixXd& Z);

  Index m_, q_;
  double sign_;
  MatrixXd V_, T_, R_;  // m x q, q x q, q x q
  MatrixXd K1_;         // q x m: the leading rows of K
  PackedCholesky packed_;
  double condition_ = 0;
};

ProjectedCholesky::ProjectedCholesky(const SaddleProblem& problem, const RunContext& context)
    : m_(static_cast<Index>(problem.centres.size())),
      q_(static_cast<Index>(problem.polynomials.terms())),
      sign_(properties(problem.kernel.kernel).sign),
      packed_(static_cast<std::size_t>(m_ - q_)) {
  lapack::use_one_thread();
  MatrixXd Z(m_, q_);
  if (q_ > 0) project(problem, context, Z);
  assemble_top(problem, Z);
  parallel_for(context, packed_.panels(), 1, [&](std::size_t panel, std::size_t) {
    assemble_panel(problem, Z, panel);
    context.progress("assemble", static_cast<double>(panel + 1) / static_cast<double>(packed_.panels()));
  });
}

void ProjectedCholesky::project(const SaddleProblem& problem, const RunContext& context, MatrixXd& Z) {
  const HouseholderQr qr(problem.polynomials.matrix(problem.centres));
  R_ = qr.packed().topRows(q_).triangularView<Eigen::Upper>();
  V_ = qr.packed().triangularView<Eigen::StrictlyLower>();
  V_.diagonal().setOnes();
  T_ = MatrixXd::Zero(q_, q_);
  for (Index i = 0; i < q_; ++i) {
    const double tau = qr.factors()[i];
    T_.col(i).head(i) = -tau * (T_.topLeftCorner(i, i) * (V_.leftCols(i).transpose() * V_.col(i)));
    T_(i, i) = tau;
  }
  const RowMajor weights = V_ * T_;
  const std::vector<double> sums = kernel_sums(problem.kernel, problem.centres, problem.centres,
                                               std::span<const double>(weights.data(), static_cast<std::size_t>(weights.size())),
                                               static_cast<std::size_t>(q_), context);
  const MatrixXd W = sign_ * Eigen::Map<const RowMajor>(sums.data(), m_, q_);
  const MatrixXd S = T_.transpose() * (V_.transpose() * W);
  Z = W - 0.5 * V_ * (0.5 * (S + S.transpose()));
}

void ProjectedCholesky::assemble_top(const SaddleProblem& problem, const MatrixXd& Z) {
  K1_.resize(q_, m_);
  for (Index i = 0; i < q_; ++i) {
    for (Index j = 0; j < m_; ++j) {
      const Vec3& a = problem.centres[static_cast<std::size_t>(i)];
      const Vec3& b = problem.centres[static_cast<std::size_t>(j)];
      K1_(i, j) = sign_ * value(problem.kernel, a, b);
    }
  }
  if (q_ > 0) K1_ -= Z.topRows(q_) * V_.transpose() + V_.topRows(q_) * Z.transpose();
}

void ProjectedCholesky::assemble_panel(const SaddleProblem& problem, const MatrixXd& Z, std::size_t panel) {
  const std::size_t q = static_cast<std::size_t>(q_);
  const std::size_t begin = q + packed_.first(panel);
  const std::size_t width = packed_.width(panel);
  const std::size_t rows = packed_.rows(panel);
  double* to = packed_.panel(panel);
  const TiledPoints tiled(problem.centres.subspan(begin, rows));
  // Both rank-q updates at once, tile by tile in the cache: minus the rows of [Z V] times the columns of [V Z].
  std::vector<double> block(width * tile_size), left(2 * q * tile_size), right(2 * q * width);
  for (std::size_t k = 0; k < q; ++k) {
    for (std::size_t j = 0; j < width; ++j) {
      const auto row = static_cast<Index>(begin + j), column = static_cast<Index>(k);
      right[k * width + j] = V_(row, column);
      right[(q + k) * width + j] = Z(row, column);
    }
  }
  for (std::size_t t = 0; t < tiled.tiles(); ++t) {
    const std::size_t first = t * tile_size;
    const std::size_t count = std::min(tile_size, rows - first);
    // Columns right of the tile's last row are above the diagonal.
    const std::size_t columns = std::min(width, first + count);
    tile_kernel(problem.kernel, tiled.tile(t), problem.centres.subspan(begin, columns), block.data());
    for (std::size_t k = 0; k < q; ++k) {
      for (std::size_t i = 0; i < count; ++i) {
        const auto row = static_cast<Index>(begin + first + i), column = static_cast<Index>(k);
        left[k * tile_size + i] = -sign_ * Z(row, column);
        left[(q + k) * tile_size + i] = -sign_ * V_(row, column);
      }
    }
    if (q > 0) tile_product(left.data(), 2 * q, right.data(), width, columns, block.data());
    for (std::size_t j = 0; j < columns; ++j) {
      for (std::size_t i = 0; i < count; ++i) to[j * rows + first + i] = sign_ * block[j * tile_size + i];
    }
  }
}

bool ProjectedCholesky::factor(const RunContext& context) {
  const double norm = packed_.norm1(context);
  if (!packed_.factor(context)) return false;
  condition_ = norm * inverse_norm1(m_ - q_, [&](Eigen::VectorXd& x) {
                 context.check();
                 packed_.solve(x.data(), static_cast<std::size_t>(x.size()), 1);
               });
  return true;
}

void ProjectedCholesky::solve(MatrixXd& B) const {
  const Index rest = m_ - q_;
  MatrixXd F = sign_ * B.topRows(m_);
  MatrixXd w1(q_, B.cols());
  if (q_ > 0) {
    F -= V_ * (T_.transpose() * (V_.transpose() * F));
    w1 = R_.transpose().triangularView<Eigen::Lower>().solve(B.bottomRows(q_));
    if (!w1.isZero(0)) F.bottomRows(rest) -= K1_.rightCols(rest).transpose() * w1;
  }
  packed_.solve(F.data() + q_, static_cast<std::size_t>(F.rows()), static_cast<std::size_t>(F.cols()));
  if (q_ > 0) {
    const MatrixXd top = F.topRows(q_) - K1_.leftCols(q_) * w1 - K1_.rightCols(rest) * F.bottomRows(rest);
    B.bottomRows(q_) = sign_ * R_.triangularView<Eigen::Upper>().solve(top);
    F.topRows(q_) = w1;
    F -= V_ * (T_ * (V_.transpose() * F));
  }
  B.topRows(m_) = F;
}

}  // namespace

std::unique_ptr<SaddleFactor> factor_cholesky(const SaddleProblem& problem, const RunContext& context) {
  auto factor = std::make_unique<ProjectedCholesky>(problem, context);
  if (!factor->factor(context)) return nullptr;
  return factor;
}

}  // namespace deform
