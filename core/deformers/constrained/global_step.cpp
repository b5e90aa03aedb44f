// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/constrained/global_step.h"

#include "core/base/parallel.h"
#include "core/deformers/constrained/sparse_sum.h"

namespace deform {

GlobalStep::GlobalStep(const ConstrainedPoints& points, const ReducedEnergy& energy, std::size_t memory_limit,
                       const RunContext& context)
    : points_(points), energy_(energy) {
  auto size = static_cast<std::int64_t>(energy_.size());
  for (const ConstraintSet& set : points_.sets()) {
    translation_.push_back(set.projection->moves_with_its_points() ? size++ : -1);
  }
  factor_ = std::make_unique<const SparseCholesky>(EnergySolver::factored(matrix(size), memory_limit, context));
}

/// Column by column, once to count and once to fill, so that nothing larger than the matrix is held.
SparseMatrix GlobalStep::matrix(std::int64_t size) const {
  if (const DenseRows* phi = points_.dense()) return dense_matrix(*phi, size);
  const SparseMatrix& weighted = points_.weighted_transposed();
  const SparseMatrix phi(points_.phi());  // by columns
  std::vector<std::int64_t> translation_of;
  for (std::size_t t = 0; t < translation_.size(); ++t) translation_of.resize(points_.first(t + 1), translation_[t]);

  SparseSum column(size);
  const auto sum_column = [&](std::int64_t c) {
    column.clear();
    for (SparseMatrix::InnerIterator at(phi, c); at; ++at) {
      for (SparseMatrix::InnerIterator it(weighted, at.row()); it; ++it) {
        if (it.row() >= c) column.add(it.row(), at.value() * it.value());
        const std::int64_t translation = translation_of[static_cast<std::size_t>(at.row())];
        if (it.row() == c && translation >= 0) column.add(translation, -it.value());
      }
    }
    for (SparseMatrix::InnerIterator it(energy_.matrix(), c); it; ++it) {
      if (it.row() >= c) column.add(it.row(), it.value());
    }
  };

  SparseMatrix result(size, size);
  Eigen::Matrix<std::int64_t, Eigen::Dynamic, 1> counts = Eigen::Matrix<std::int64_t, Eigen::Dynamic, 1>::Ones(size);
  for (std::int64_t c = 0; c < phi.cols(); ++c) {
    sum_column(c);
    counts[c] = static_cast<std::int64_t>(column.count());
  }
  result.reserve(counts);
  for (std::int64_t c = 0; c < phi.cols(); ++c) {
    sum_column(c);
    for (const std::int64_t row : column.places()) result.insert(row, c) = column.value(row);
  }
  for (std::size_t t = 0; t < translation_.size(); ++t) {
    if (translation_[t] >= 0) result.insert(translation_[t], translation_[t]) = points_.sets()[t].weight;
  }
  result.makeCompressed();
  return result;
}

SparseMatrix GlobalStep::dense_matrix(const DenseRows& phi, std::int64_t size) const {
  SparseRows weighted = phi.spread();  // G P
  Eigen::MatrixXd borders = Eigen::MatrixXd::Zero(size - phi.values().cols(), phi.values().cols());
  for (std::size_t t = 0; t < translation_.size(); ++t) {
    const double weight = points_.weight_per_point(t);
    Eigen::VectorXd sum = Eigen::VectorXd::Zero(phi.values().rows());  // P^T G 1 of the set
    for (std::size_t i = points_.first(t); i < points_.first(t + 1); ++i) {
      for (SparseRows::InnerIterator it(weighted, static_cast<std::int64_t>(i)); it; ++it) {
        it.valueRef() *= weight;
        sum[it.col()] += it.value();
      }
    }
    if (translation_[t] >= 0) borders.row(translation_[t] - phi.values().cols()) = -(phi.values().transpose() * sum).transpose();
  }
  Eigen::MatrixXd H = phi.product(SparseMatrix(SparseMatrix(phi.spread().transpose()) * SparseMatrix(weighted)));
  for (std::int64_t j = 0; j < H.cols(); ++j) {
    for (SparseMatrix::InnerIterator it(energy_.matrix(), j); it; ++it) H(it.row(), j) += it.value();
  }
  SparseMatrix result(size, size);
  result.reserve(H.cols() * (H.cols() + 1) / 2 + borders.size() + borders.rows());
  for (std::int64_t j = 0; j < H.cols(); ++j) {
    result.startVec(j);
    for (std::int64_t i = j; i < H.rows(); ++i) result.insertBack(i, j) = H(i, j);
    for (std::int64_t i = 0; i < borders.rows(); ++i) {
      if (borders(i, j) != 0) result.insertBack(H.rows() + i, j) = borders(i, j);
    }
  }
  for (std::size_t t = 0; t < translation_.size(); ++t) {
    if (translation_[t] < 0) continue;
    result.startVec(translation_[t]);
    result.insertBack(translation_[t], translation_[t]) = points_.sets()[t].weight;
  }
  result.finalize();
  return result;
}

Eigen::MatrixXd GlobalStep::solve(const Eigen::MatrixXd& top, const std::vector<Vec3>& targets, const RunContext& context) const {
  const auto r = static_cast<Eigen::Index>(energy_.size());
  Eigen::MatrixXd b = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(factor_->size()), 3);
  if (!targets.empty()) {
    b.topRows(r) = points_.weighted_sums(targets);
    for (std::size_t t = 0; t < translation_.size(); ++t) {
      if (translation_[t] < 0) continue;
      Vec3 sum{};
      for (std::size_t i = points_.first(t); i < points_.first(t + 1); ++i) {
        for (std::size_t k = 0; k < 3; ++k) sum[k] += targets[i][k];
      }
      for (Eigen::Index k = 0; k < 3; ++k) {
        b(translation_[t], k) = -points_.weight_per_point(t) * sum[static_cast<std::size_t>(k)];
      }
    }
  }
  if (top.size() > 0) b.topRows(r) += top;
  parallel_for(context, 3, 1, [&](std::size_t c, std::size_t) { factor_->solve_in_place(b.col(static_cast<Eigen::Index>(c))); });
  return b.topRows(r);
}

}  // namespace deform
