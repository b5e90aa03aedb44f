#include "core/deformers/constrained_solver.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

#include "core/base/parallel.h"
#include "core/deformers/anderson.h"

namespace deform {

namespace {

using Entry = Eigen::Triplet<double, std::int64_t>;
constexpr int rounds = 3;                // of multipliers: updates of the loads
constexpr double round_accuracy = 1e-9;  // of the prescribed displacements

double rms(const std::vector<Vec3>& a, const std::vector<Vec3>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) sum += (a[i][k] - b[i][k]) * (a[i][k] - b[i][k]);
  }
  return std::sqrt(sum / static_cast<double>(std::max<std::size_t>(1, a.size())));
}

}  // namespace

ConstrainedSolver::ConstrainedSolver(const EnergySolver& solver, const SparseRows& values, std::vector<ConstraintSet> sets,
                                     const Options& options, std::size_t memory_limit, const RunContext& context)
    : solver_(solver), sets_(std::move(sets)), options_(options) {
  const auto k = static_cast<std::int64_t>(solver_.unknowns());
  std::int64_t size = k;
  first_.push_back(0);
  std::vector<Entry> rows, matrix;
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    for (std::size_t i = 0; i < sets_[t].ids.size(); ++i) {
      for (SparseRows::InnerIterator it(values, sets_[t].ids[i]); it; ++it) {
        rows.emplace_back(static_cast<std::int64_t>(first_.back() + i), it.col(), it.value());
      }
    }
    first_.push_back(first_.back() + sets_[t].ids.size());
    translation_.push_back(sets_[t].projection->moves_with_its_points() ? size++ : -1);
  }
  phi_.resize(static_cast<std::int64_t>(first_.back()), k);
  phi_.setFromTriplets(rows.begin(), rows.end());
  transposed_ = SparseMatrix(phi_.transpose());
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    for (std::size_t i = first_[t]; i < first_[t + 1]; ++i) {
      for (SparseMatrix::InnerIterator it(transposed_, static_cast<std::int64_t>(i)); it; ++it) it.valueRef() *= per_point(t);
    }
  }
  // [ A + sum g Phi^T Phi   . ]     one row -g 1^T Phi_t per translation
  // [ -g 1^T Phi_t        g n ]
  const SparseMatrix square = SparseMatrix(transposed_ * SparseMatrix(phi_)).triangularView<Eigen::Lower>();
  const SparseMatrix top = solver_.matrix() + square;
  for (std::int64_t c = 0; c < k; ++c) {
    for (SparseMatrix::InnerIterator it(top, c); it; ++it) matrix.emplace_back(it.row(), c, it.value());
  }
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    if (translation_[t] < 0) continue;
    matrix.emplace_back(translation_[t], translation_[t], sets_[t].weight);
    for (std::size_t i = first_[t]; i < first_[t + 1]; ++i) {
      for (SparseMatrix::InnerIterator it(transposed_, static_cast<std::int64_t>(i)); it; ++it) {
        matrix.emplace_back(translation_[t], it.row(), -it.value());
      }
    }
  }
  SparseMatrix bordered(size, size);
  bordered.setFromTriplets(matrix.begin(), matrix.end());
  factor_ = std::make_unique<const SparseCholesky>(EnergySolver::factored(bordered, memory_limit, context));
}

std::size_t ConstrainedSolver::bytes() const {
  return factor_->bytes() + sparse_bytes(phi_) + sparse_bytes(transposed_) + first_.back() * (sizeof(Vec3) + sizeof(PointId));
}

/// Solution for the right-hand side `top` plus the weighted transposed rows of values at the points.
Eigen::MatrixXd ConstrainedSolver::solve_bordered(const Eigen::MatrixXd& top, const std::vector<Vec3>& at_points,
                                                  const RunContext& context) const {
  const auto k = static_cast<Eigen::Index>(solver_.unknowns());
  Eigen::MatrixXd b = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(factor_->size()), 3);
  parallel_for(context, 3, 1, [&](std::size_t c, std::size_t) {
    const auto column = static_cast<Eigen::Index>(c);
    Eigen::VectorXd y(static_cast<Eigen::Index>(at_points.size()));
    for (std::size_t i = 0; i < at_points.size(); ++i) y[static_cast<Eigen::Index>(i)] = at_points[i][c];
    b.col(column).head(k) = top.col(column) + transposed_ * y;
    for (std::size_t t = 0; t < sets_.size(); ++t) {
      if (translation_[t] < 0) continue;
      double sum = 0;
      for (std::size_t i = first_[t]; i < first_[t + 1]; ++i) sum += at_points[i][c];
      b(translation_[t], column) = -per_point(t) * sum;
    }
    factor_->solve_in_place(b.col(column));
  });
  return b.topRows(k);
}

/// Displacements of the points of the sets.
std::vector<Vec3> ConstrainedSolver::rows_times(const Eigen::MatrixXd& w) const {
  std::vector<Vec3> result(first_.back(), Vec3{});
  for (std::size_t i = 0; i < result.size(); ++i) {
    for (SparseRows::InnerIterator it(phi_, static_cast<std::int64_t>(i)); it; ++it) {
      for (std::size_t k = 0; k < 3; ++k) result[i][k] += it.value() * w(it.col(), static_cast<Eigen::Index>(k));
    }
  }
  return result;
}

Eigen::MatrixXd ConstrainedSolver::global_step(const Case& c, const std::vector<Vec3>& targets) const {
  std::vector<Vec3> y(targets.size());
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    for (std::size_t i = first_[t]; i < first_[t + 1]; ++i) {
      for (std::size_t k = 0; k < 3; ++k) y[i][k] = targets[i][k] - sets_[t].rest[i - first_[t]][k] - c.offsets[i][k];
    }
  }
  return solve_bordered(c.base, y, c.context);
}

double ConstrainedSolver::deformation_energy(const Case& c, const Eigen::MatrixXd& w) const {
  const EnergySolver::Problem& problem = solver_.problem();
  const Eigen::MatrixXd Kw = problem.energy.selfadjointView<Eigen::Lower>() * w;
  double energy = w.cwiseProduct(Kw).sum();
  if (problem.hold == Hold::eliminated) return energy - 2 * w.cwiseProduct(c.base).sum();
  const Eigen::MatrixXd misfit = problem.coupling.transpose() * w - c.loads;
  for (Eigen::Index i = 0; i < misfit.rows(); ++i) energy += problem.weights[i] * misfit.row(i).squaredNorm();
  return energy;
}

/// Points, projections and objective of state.w.
void ConstrainedSolver::evaluate(const Case& c, ConstrainedState& state) const {
  state.points = rows_times(state.w);
  state.targets.resize(state.points.size());
  state.shapes.resize(sets_.size());
  state.squares.assign(sets_.size(), 0.0);
  state.objective = deformation_energy(c, state.w);
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    const std::size_t first = first_[t], count = first_[t + 1] - first;
    for (std::size_t i = 0; i < count; ++i) {
      for (std::size_t k = 0; k < 3; ++k) state.points[first + i][k] += sets_[t].rest[i][k] + c.offsets[first + i][k];
    }
    state.squares[t] = sets_[t].projection->project({state.points.data() + first, count}, {state.targets.data() + first, count},
                                                    state.shapes[t]);
    state.objective += per_point(t) * state.squares[t];
  }
}

/// How far the points would move if the forces that the last step left unbalanced met the deformation energy alone: right for the
/// slow modes of the alternation, along the shapes, and too much for the others, which are balanced long before.
double ConstrainedSolver::distance_left(const Case& c, const std::vector<Vec3>& from, const std::vector<Vec3>& to) const {
  Eigen::MatrixXd b(static_cast<Eigen::Index>(solver_.unknowns()), 3);
  parallel_for(c.context, 3, 1, [&](std::size_t k, std::size_t) {
    Eigen::VectorXd y(static_cast<Eigen::Index>(to.size()));
    for (std::size_t i = 0; i < to.size(); ++i) y[static_cast<Eigen::Index>(i)] = to[i][k] - from[i][k];
    b.col(static_cast<Eigen::Index>(k)) = transposed_ * y;
    solver_.factor().solve_in_place(b.col(static_cast<Eigen::Index>(k)));
  });
  const std::vector<Vec3> moved = rows_times(b);
  return rms(moved, std::vector<Vec3>(moved.size(), Vec3{}));
}

void ConstrainedSolver::alternate(const Case& c, int most, ConstrainedResult& result) const {
  ConstrainedState& now = result.after;
  Anderson window;
  std::vector<Vec3> from = now.targets;  // what the last global step went towards
  bool accelerated = false;
  double check_below = HUGE_VAL;  // step at which it is worth asking again how far the fixed point is
  const int last = std::min(most, result.iterations + options_.patience);
  while (result.iterations < last) {
    c.context.check();
    ConstrainedState next;
    next.w = global_step(c, from);
    next.shapes = now.shapes;
    evaluate(c, next);
    ++result.iterations;
    const double slack = 1e-13 * (std::abs(now.objective) + std::abs(next.objective));
    if (accelerated && !(next.objective <= now.objective + slack)) {
      window.clear();
      from = now.targets;
      accelerated = false;
      continue;
    }
    now = std::move(next);
    result.objectives.push_back(now.objective);
    const double rho = window.add(from, now.targets);
    const double step = rms(from, now.targets);
    if (step == 0 || (window.size() > 0 && rho < 1 && step * rho / (1 - rho) <= options_.tolerance && step <= check_below)) {
      result.error = distance_left(c, from, now.targets);
      if (result.error <= options_.tolerance) {
        result.converged = true;
        return;
      }
      check_below = step * std::max(0.1, std::min(0.9, options_.tolerance / result.error));
    }
    accelerated = options_.acceleration == Acceleration::anderson && window.size() > 0;
    from = accelerated ? window.next() : now.targets;
  }
}

ConstrainedResult ConstrainedSolver::solve(const Eigen::MatrixXd& h, const std::vector<Vec3>& offsets,
                                           const RunContext& context) const {
  ConstrainedResult result;
  Case c{solver_.loads(h, context), {}, offsets, context};
  c.base = solver_.right_side(c.loads);
  result.before.w = c.base;
  for (Eigen::Index k = 0; k < 3; ++k) solver_.factor().solve_in_place(result.before.w.col(k));
  evaluate(c, result.before);
  result.after = result.before;
  const bool multipliers = solver_.problem().hold == Hold::multipliers;
  const double wanted = round_accuracy * (h.size() > 0 ? h.cwiseAbs().maxCoeff() : 0.0);
  for (int round = 1;; ++round) {
    result.converged = false;
    result.objectives.clear();
    const int most = result.iterations + options_.most_iterations;
    do {
      alternate(c, most, result);
      if (!result.converged && options_.acceleration != Acceleration::none) newton(c, result);
    } while (!result.converged && result.iterations < most);
    if (!multipliers || round == rounds || !result.converged) return result;
    const Eigen::MatrixXd missing = h - solver_.problem().coupling.transpose() * result.after.w;
    if (missing.size() == 0 || missing.cwiseAbs().maxCoeff() <= wanted) return result;
    c.loads += missing;
    c.base = solver_.right_side(c.loads);
    evaluate(c, result.after);
  }
}

}  // namespace deform
