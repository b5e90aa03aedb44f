#include "core/deformers/constrained/constrained_solver.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

#include "core/base/parallel.h"
#include "core/deformers/constrained/anderson.h"

namespace deform {

namespace {

constexpr double round_accuracy = 1e-9;  // of the prescribed displacements
constexpr std::size_t sets_per_task = 64;

double rms(const std::vector<Vec3>& a, const std::vector<Vec3>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) sum += (a[i][k] - b[i][k]) * (a[i][k] - b[i][k]);
  }
  return std::sqrt(sum / static_cast<double>(std::max<std::size_t>(1, a.size())));
}

}  // namespace

void ConstrainedSolver::evaluate(const Case& c, ConstrainedState& state) const {
  state.points = rows_times(state.v);
  state.targets.resize(state.points.size());
  state.shapes.resize(sets_.size());
  state.squares.assign(sets_.size(), 0.0);
  parallel_for(c.context, sets_.size(), sets_per_task, [&](std::size_t begin, std::size_t end) {
    for (std::size_t t = begin; t < end; ++t) {
      const std::size_t first = first_[t], count = set_size(t);
      for (std::size_t i = first; i < first + count; ++i) {
        for (std::size_t k = 0; k < 3; ++k) state.points[i][k] += c.unconstrained[i][k];
      }
      state.squares[t] = sets_[t].projection->project({state.points.data() + first, count}, {state.targets.data() + first, count},
                                                      state.shapes[t]);
    }
  });
  state.objective = state.v.cwiseProduct(reduced_.times(state.v)).sum();
  for (std::size_t t = 0; t < sets_.size(); ++t) state.objective += per_point(t) * state.squares[t];
}

Eigen::MatrixXd ConstrainedSolver::global_step(const Case& c, const std::vector<Vec3>& targets) const {
  std::vector<Vec3> y(targets.size());
  for (std::size_t i = 0; i < y.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) y[i][k] = targets[i][k] - c.unconstrained[i][k];
  }
  return solve_bordered({}, y, c.context);
}

/// How far the points would move if the forces that the last step left unbalanced met the deformation energy alone: right for the
/// slow modes of the alternation, along the shapes, and too much for the others, which are balanced long before.
double ConstrainedSolver::distance_left(const Case& c, const std::vector<Vec3>& from, const std::vector<Vec3>& to) const {
  std::vector<Vec3> y(to.size());
  for (std::size_t i = 0; i < y.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) y[i][k] = to[i][k] - from[i][k];
  }
  Eigen::MatrixXd b = weighted_transposed(y);
  parallel_for(c.context, 3, 1,
               [&](std::size_t k, std::size_t) { reduced_.solve_in_place(b.col(static_cast<Eigen::Index>(k))); });
  const std::vector<Vec3> moved = rows_times(b);
  return rms(moved, std::vector<Vec3>(moved.size(), Vec3{}));
}

void ConstrainedSolver::alternate(const Case& c, int most, ConstrainedResult& result) const {
  ConstrainedState& now = result.after;
  Anderson window;
  std::vector<Vec3> from = now.targets;  // what the last global step went towards
  bool accelerated = false;
  double check_below = HUGE_VAL;  // step at which it is worth asking again how far the fixed point is
  while (result.iterations < most) {
    c.context.check();
    ConstrainedState next;
    next.v = global_step(c, from);
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

ConstrainedResult ConstrainedSolver::solve(const Eigen::MatrixXd& h, const std::vector<Vec3>& offsets, const RunContext& context,
                                           const ConstrainedStart* start_from) const {
  const EnergySolver::Problem& problem = solver_.problem();
  ConstrainedResult result;
  Eigen::MatrixXd loads = solver_.loads(h, context);
  Eigen::MatrixXd free;  // the solution without constraints
  Case c{{}, context};
  const auto start = [&] {
    free = solver_.solve_loads(loads, context);
    c.unconstrained = rows_times(reduced_.picked(free));
    for (std::size_t t = 0; t < sets_.size(); ++t) {
      for (std::size_t i = first_[t]; i < first_[t + 1]; ++i) {
        for (std::size_t k = 0; k < 3; ++k) c.unconstrained[i][k] += sets_[t].rest[i - first_[t]][k] + offsets[i][k];
      }
    }
  };
  start();
  result.before.v = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(reduced_.size()), 3);
  evaluate(c, result.before);
  result.after = result.before;
  bool near = start_from != nullptr;  // the solution
  if (near) {
    ConstrainedState warm;
    warm.v = start_from->v;
    warm.shapes = start_from->shapes;
    evaluate(c, warm);
    near = warm.objective < result.before.objective;
    if (near) result.after = std::move(warm);
  }
  const bool multipliers = problem.hold == Hold::multipliers;
  const double wanted = round_accuracy * (h.size() > 0 ? h.cwiseAbs().maxCoeff() : 0.0);
  NewtonPtr matrix;
  const bool newton_too = newton_form_ != NewtonForm::none && options_.acceleration != Acceleration::none;
  for (int round = 1;; ++round) {
    result.converged = false;
    result.objectives.clear();
    if (near && newton_too) newton(c, result, matrix);
    while (!result.converged && result.iterations < options_.most_iterations) {
      const int last = newton_too ? result.iterations + patience_ : options_.most_iterations;
      alternate(c, std::min(options_.most_iterations, last), result);
      if (!result.converged && newton_too) newton(c, result, matrix);
    }
    result.w = free + reduced_.extended(result.after.v, context);
    if (!multipliers || round == rounds || !result.converged) return result;
    const Eigen::MatrixXd missing = h - problem.coupling.transpose() * result.w;
    if (missing.size() == 0 || missing.cwiseAbs().maxCoeff() <= wanted) return result;
    result.rounds.push_back(result.after);
    loads += missing;
    start();
    evaluate(c, result.after);
    near = true;
  }
}

}  // namespace deform
