// The matrix of the global step and what it takes from the points.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

#include "core/base/parallel.h"
#include "core/deformers/constrained/constrained_solver.h"

namespace deform {

namespace {

using Entry = Eigen::Triplet<double, std::int64_t>;

constexpr int least_patience = 4, most_patience = 150;
constexpr double steps_per_round = 1;  // Gauss-Newton matrices that one round of the alternation may cost
constexpr double dense_speed = 8;      // operations of a factorization in the time of one of a triangular solution
constexpr std::size_t columns_per_task = 16;
constexpr std::size_t permuted_and_factored = 2;  // copies of a sparse matrix, in factors

}  // namespace

std::vector<std::int64_t> functions_reaching(const SparseRows& values, const std::vector<ConstraintSet>& sets) {
  std::vector<bool> reaches(static_cast<std::size_t>(values.cols()), false);
  for (const ConstraintSet& set : sets) {
    for (const PointId id : set.ids) {
      for (SparseRows::InnerIterator it(values, id); it; ++it) reaches[static_cast<std::size_t>(it.col())] = true;
    }
  }
  std::vector<std::int64_t> result;
  for (std::size_t j = 0; j < reaches.size(); ++j) {
    if (reaches[j]) result.push_back(static_cast<std::int64_t>(j));
  }
  return result;
}

ConstrainedSolver::ConstrainedSolver(const EnergySolver& solver, const SparseRows& values, std::vector<ConstraintSet> sets,
                                     const Options& options, std::size_t memory_limit, const RunContext& context)
    : solver_(solver),
      sets_(std::move(sets)),
      options_(options),
      reduced_(solver, functions_reaching(values, sets_), memory_limit, context) {
  const auto r = static_cast<std::int64_t>(reduced_.size());
  std::vector<std::int64_t> place(solver_.unknowns(), -1);
  for (std::int64_t i = 0; i < r; ++i) place[static_cast<std::size_t>(reduced_.function(static_cast<std::size_t>(i)))] = i;
  std::int64_t size = r;
  first_.push_back(0);
  std::vector<Entry> rows;
  for (const ConstraintSet& set : sets_) {
    for (std::size_t i = 0; i < set.ids.size(); ++i) {
      for (SparseRows::InnerIterator it(values, set.ids[i]); it; ++it) {
        rows.emplace_back(static_cast<std::int64_t>(first_.back() + i), place[static_cast<std::size_t>(it.col())], it.value());
      }
    }
    first_.push_back(first_.back() + set.ids.size());
    const bool bordered = options_.form == Form::bordered && set.projection->moves_with_its_points();
    translation_.push_back(bordered ? size++ : -1);
  }
  phi_.resize(static_cast<std::int64_t>(first_.back()), r);
  phi_.setFromTriplets(rows.begin(), rows.end());
  transposed_ = SparseMatrix(phi_.transpose());
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    for (std::size_t i = first_[t]; i < first_[t + 1]; ++i) {
      for (SparseMatrix::InnerIterator it(transposed_, static_cast<std::int64_t>(i)); it; ++it) it.valueRef() *= per_point(t);
    }
  }
  factor_ = std::make_unique<const SparseCholesky>(EnergySolver::factored(constrained_matrix(), memory_limit, context));
  const double newton_step = newton_by_cost(memory_limit);
  if (newton_form_ == NewtonForm::sparse) newton_order_ = solver_.factor().order();
  if (newton_form_ == NewtonForm::forces) prepare_compliance(context);
  patience_ = options_.patience > 0 ? options_.patience : patience_by_cost(newton_step);
}

/// [ S + sum g Phi^T Phi   . ]     one row -g 1^T Phi_t per translation; the other forms have C_t Phi_t for Phi_t and no rows
/// [ -g 1^T Phi_t        g n ]
SparseMatrix ConstrainedSolver::constrained_matrix() const {
  std::int64_t size = phi_.cols();
  for (const std::int64_t row : translation_) size += row >= 0 ? 1 : 0;
  const SparseMatrix& S = reduced_.matrix();
  std::vector<Entry> entries;
  const auto add = [&](const SparseMatrix& lower) {
    for (std::int64_t c = 0; c < lower.cols(); ++c) {
      for (SparseMatrix::InnerIterator it(lower, c); it; ++it) {
        if (it.row() >= c) entries.emplace_back(it.row(), c, it.value());
      }
    }
  };
  add(S);
  if (options_.form == Form::bordered) {
    add(SparseMatrix(transposed_ * SparseMatrix(phi_)));
  } else {
    for (std::size_t t = 0; t < sets_.size(); ++t) {
      const auto first = static_cast<std::int64_t>(first_[t]), count = static_cast<std::int64_t>(set_size(t));
      const SparseMatrix rows = SparseRows(phi_.middleRows(first, count));
      SparseMatrix centre(count, count);  // C_t
      std::vector<Entry> parts;
      for (std::int64_t i = 0; i < count; ++i) {
        parts.emplace_back(i, i, 1.0);
        if (!sets_[t].projection->moves_with_its_points()) continue;
        for (std::int64_t j = 0; options_.form == Form::mean_centred && j < count; ++j) {
          parts.emplace_back(i, j, -1 / static_cast<double>(count));
        }
        if (options_.form == Form::anchored) parts.emplace_back(i, 0, -1.0);
      }
      centre.setFromTriplets(parts.begin(), parts.end());
      const SparseMatrix centred_rows = centre * rows;
      add(SparseMatrix(per_point(t) * SparseMatrix(centred_rows.transpose()) * centred_rows));
    }
  }
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    if (translation_[t] < 0) continue;
    entries.emplace_back(translation_[t], translation_[t], sets_[t].weight);
    for (std::size_t i = first_[t]; i < first_[t + 1]; ++i) {
      for (SparseMatrix::InnerIterator it(transposed_, static_cast<std::int64_t>(i)); it; ++it) {
        entries.emplace_back(translation_[t], it.row(), -it.value());
      }
    }
  }
  SparseMatrix result(size, size);
  result.setFromTriplets(entries.begin(), entries.end());
  return result;
}

/// Operations of a step.
double ConstrainedSolver::newton_by_cost(std::size_t memory_limit) {
  NewtonSizes sizes;
  for (const ConstraintSet& set : sets_) sizes.add(*set.projection, set.rest);
  sizes.functions = reduced_.size();
  sizes.dense = reduced_.dense();
  sizes.factor_bytes = factor_->bytes();
  sizes.factor_operations = factor_->flops();
  const NewtonChoice choice = cheapest_newton(sizes, memory_limit);
  newton_form_ = choice.form;
  const std::size_t size = 3 * sizes.functions + sizes.parameters;
  const std::size_t matrix = choice.form == NewtonForm::forces   ? sizes.rows * (sizes.rows + 2 * sizes.parameters)
                             : choice.form == NewtonForm::full   ? size * size
                             : choice.form == NewtonForm::sparse ? permuted_and_factored * 9 * factor_->bytes() / sizeof(double)
                                                                 : 0;
  const std::size_t vectors = 40 * point_count() + 24 * sizes.functions + 12 * solver_.unknowns();
  working_bytes_ = matrix * sizeof(double) + vectors * sizeof(Vec3);
  return choice.operations;
}

int ConstrainedSolver::patience_by_cost(double newton_step) const {
  if (newton_form_ == NewtonForm::none) return most_patience;
  const double iteration =
      12.0 * static_cast<double>(factor_->bytes()) / sizeof(double) + 40.0 * static_cast<double>(phi_.nonZeros());
  const double ratio = steps_per_round * newton_step / (dense_speed * iteration);
  return static_cast<int>(std::clamp(ratio, double{least_patience}, double{most_patience}));
}

/// Columns are independent of each other: the same for any number of threads.
void ConstrainedSolver::prepare_compliance(const RunContext& context) {
  const auto N = static_cast<Eigen::Index>(point_count());
  compliance_.resize(N, N);
  parallel_for(context, point_count(), columns_per_task, [&](std::size_t begin, std::size_t end) {
    for (auto i = static_cast<Eigen::Index>(begin); i < static_cast<Eigen::Index>(end); ++i) {
      Eigen::VectorXd b = Eigen::VectorXd::Zero(phi_.cols());
      for (SparseRows::InnerIterator it(phi_, i); it; ++it) b[it.col()] = it.value();
      reduced_.solve_in_place(b);
      compliance_.col(i) = phi_ * b;
    }
  });
}

std::size_t ConstrainedSolver::bytes() const {
  return static_cast<std::size_t>(compliance_.size()) * sizeof(double) + reduced_.bytes() + factor_->bytes() +
         sparse_bytes(phi_) + sparse_bytes(transposed_) + first_.back() * (sizeof(Vec3) + sizeof(PointId));
}

/// C^T C y of the thesis' forms.
std::vector<Vec3> ConstrainedSolver::centred(const std::vector<Vec3>& y) const {
  std::vector<Vec3> result = y;
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    if (!sets_[t].projection->moves_with_its_points()) continue;
    const std::size_t first = first_[t], last = first_[t + 1];
    for (std::size_t k = 0; k < 3; ++k) {
      double sum = 0;
      for (std::size_t i = first; i < last; ++i) sum += y[i][k];
      const double shift = options_.form == Form::anchored ? y[first][k] : sum / static_cast<double>(last - first);
      for (std::size_t i = first; i < last; ++i) result[i][k] -= shift;
      if (options_.form == Form::anchored) result[first][k] = static_cast<double>(last - first) * shift - sum;
    }
  }
  return result;
}

/// Phi^T times the weights times y.
Eigen::MatrixXd ConstrainedSolver::weighted_transposed(const std::vector<Vec3>& y) const {
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(transposed_.rows(), 3);
  for (std::size_t i = 0; i < y.size(); ++i) {
    for (SparseMatrix::InnerIterator it(transposed_, static_cast<std::int64_t>(i)); it; ++it) {
      for (Eigen::Index k = 0; k < 3; ++k) result(it.row(), k) += it.value() * y[i][static_cast<std::size_t>(k)];
    }
  }
  return result;
}

/// Solution for the right-hand side `top` (empty: zero) plus what the points pull.
Eigen::MatrixXd ConstrainedSolver::solve_bordered(const Eigen::MatrixXd& top, const std::vector<Vec3>& at_points,
                                                  const RunContext& context) const {
  const auto r = static_cast<Eigen::Index>(reduced_.size());
  Eigen::MatrixXd b = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(factor_->size()), 3);
  if (!at_points.empty()) {
    b.topRows(r) = weighted_transposed(options_.form == Form::bordered ? at_points : centred(at_points));
    for (std::size_t t = 0; t < sets_.size(); ++t) {
      if (translation_[t] < 0) continue;
      Vec3 sum{};
      for (std::size_t i = first_[t]; i < first_[t + 1]; ++i) {
        for (std::size_t k = 0; k < 3; ++k) sum[k] += at_points[i][k];
      }
      for (Eigen::Index k = 0; k < 3; ++k) b(translation_[t], k) = -per_point(t) * sum[static_cast<std::size_t>(k)];
    }
  }
  if (top.size() > 0) b.topRows(r) += top;
  parallel_for(context, 3, 1, [&](std::size_t c, std::size_t) { factor_->solve_in_place(b.col(static_cast<Eigen::Index>(c))); });
  return b.topRows(r);
}

/// Displacements of the points of the sets.
std::vector<Vec3> ConstrainedSolver::rows_times(const Eigen::MatrixXd& v) const {
  std::vector<Vec3> result(first_.back(), Vec3{});
  for (std::size_t i = 0; i < result.size(); ++i) {
    for (SparseRows::InnerIterator it(phi_, static_cast<std::int64_t>(i)); it; ++it) {
      for (std::size_t k = 0; k < 3; ++k) result[i][k] += it.value() * v(it.col(), static_cast<Eigen::Index>(k));
    }
  }
  return result;
}

}  // namespace deform
