// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/constrained/global_step.h"

#include "core/base/parallel.h"

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

SparseMatrix GlobalStep::matrix(std::int64_t size) const {
  const SparseMatrix& transposed = points_.weighted_transposed();
  std::vector<Eigen::Triplet<double, std::int64_t>> entries;
  const auto add = [&](const SparseMatrix& lower) {
    for (std::int64_t c = 0; c < lower.cols(); ++c) {
      for (SparseMatrix::InnerIterator it(lower, c); it; ++it) {
        if (it.row() >= c) entries.emplace_back(it.row(), c, it.value());
      }
    }
  };
  add(energy_.matrix());
  add(SparseMatrix(transposed * SparseMatrix(points_.phi())));
  for (std::size_t t = 0; t < translation_.size(); ++t) {
    if (translation_[t] < 0) continue;
    entries.emplace_back(translation_[t], translation_[t], points_.sets()[t].weight);
    for (std::size_t i = points_.first(t); i < points_.first(t + 1); ++i) {
      for (SparseMatrix::InnerIterator it(transposed, static_cast<std::int64_t>(i)); it; ++it) {
        entries.emplace_back(translation_[t], it.row(), -it.value());
      }
    }
  }
  SparseMatrix result(size, size);
  result.setFromTriplets(entries.begin(), entries.end());
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
