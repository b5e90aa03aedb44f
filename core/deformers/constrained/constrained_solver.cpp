// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/constrained/constrained_solver.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/deformers/constrained/anderson.h"
#include "core/numerics/sparse/conjugate_gradients.h"

namespace deform {

namespace {

constexpr double round_accuracy = 1e-9;  // of the prescribed displacements
constexpr std::size_t sets_per_task = 64;
constexpr double direction_accuracy = 1e-3;
constexpr int most_with_old_matrix = 12;  // iterations; a new matrix costs about as much or more
constexpr int most_gradient_steps = 1000;
constexpr int most_steps = 30, most_halvings = 10, most_steps_of_a_design = 100;
constexpr int most_refits = 8;
constexpr double rounding_of_objective = 1e-13;      // of its size
constexpr double nearest_error = 1e-11;              // that is reported
constexpr int most_idle = 300, most_idle_steps = 3;  // iterations and Newton steps that come no nearer
constexpr double as_converged = 1e-7;                // error from which the alternation may end at rounding
constexpr double whole_accuracy = 1e-11;             // of the right-hand side, of derivatives

double rms(const std::vector<Vec3>& vectors) {
  double sum = 0;
  for (const Vec3& u : vectors) sum += dot(u, u);
  return std::sqrt(sum / static_cast<double>(std::max<std::size_t>(1, vectors.size())));
}

std::vector<Vec3> differences(const std::vector<Vec3>& a, const std::vector<Vec3>& b) {
  std::vector<Vec3> result(a.size());
  for (std::size_t i = 0; i < a.size(); ++i) result[i] = a[i] - b[i];
  return result;
}

/// V of all functions if the solver is to have a basis, else nothing.
Eigen::MatrixXd basis_values(const EnergySolver& solver, const FunctionRows& values, const std::vector<ConstraintSet>& sets,
                             const DeliveredRows* delivered) {
  if (delivered == nullptr) return {};
  const DeliveredRows::Form form = DeliveredRows::form(delivered->points(), functions_reaching(values, sets, delivered).size(),
                                                       solver.unknowns(), solver.factor().bytes() / sizeof(double));
  return form == DeliveredRows::Form::basis ? delivered->values(values, nullptr) : Eigen::MatrixXd();
}

}  // namespace

ConstrainedSolver::ConstrainedSolver(const EnergySolver& solver, const FunctionRows& values, std::vector<ConstraintSet> sets,
                                     const Options& options, std::size_t memory_limit, const RunContext& context,
                                     const DeliveredRows* delivered)
    : solver_(solver),
      options_(options),
      delivered_values_(basis_values(solver, values, sets, delivered)),
      reduced_(delivered_values_.size() > 0
                   ? ReducedEnergy(solver, delivered_values_, memory_limit, context)
                   : ReducedEnergy(solver, functions_reaching(values, sets, delivered), memory_limit, context)),
      points_(std::move(sets), values, reduced_, delivered, std::move(delivered_values_)),
      global_step_(points_, reduced_, memory_limit, context),
      gauss_newton_(points_, reduced_, global_step_.factor(), memory_limit, context),
      patience_(options_.patience > 0 ? options_.patience : patience_by_cost()) {}

int ConstrainedSolver::patience_by_cost() const {
  return newton_patience(gauss_newton_.form(), gauss_newton_.operations(), global_step_.factor().bytes(), points_.entries());
}

std::size_t ConstrainedSolver::bytes() const {
  return gauss_newton_.bytes() + reduced_.bytes() + global_step_.factor().bytes() + points_.bytes();
}

std::size_t ConstrainedSolver::working_bytes() const {
  const std::size_t vectors = 40 * points_.count() + 24 * reduced_.size() + 12 * solver_.unknowns();
  return gauss_newton_.matrix_bytes() + vectors * sizeof(Vec3);
}

void ConstrainedSolver::evaluate(const Case& c, ConstrainedState& state) const {
  state.points = points_.displacements(state.v);
  state.targets.resize(state.points.size());
  state.shapes.resize(sets().size());
  state.squares.assign(sets().size(), 0.0);
  parallel_for(c.context, sets().size(), sets_per_task, [&](std::size_t begin, std::size_t end) {
    for (std::size_t t = begin; t < end; ++t) {
      const std::size_t first = points_.first(t), count = points_.size(t);
      for (std::size_t i = first; i < first + count; ++i) {
        for (std::size_t k = 0; k < 3; ++k) state.points[i][k] += c.unconstrained[i][k];
      }
      state.squares[t] = sets()[t].solved_projection().project({state.points.data() + first, count},
                                                               {state.targets.data() + first, count}, state.shapes[t]);
    }
  });
  state.objective = state.v.cwiseProduct(reduced_.times(state.v)).sum();
  for (std::size_t t = 0; t < sets().size(); ++t) state.objective += points_.weight_per_point(t) * state.squares[t];
}

/// The change of v if forces that are left unbalanced met the deformation energy alone: right for the slow modes of the
/// alternation, along the shapes, and too much for the others, which are balanced long before.
Eigen::MatrixXd ConstrainedSolver::response(const Case& c, Eigen::MatrixXd forces) const {
  parallel_for(c.context, 3, 1,
               [&](std::size_t k, std::size_t) { reduced_.solve_in_place(forces.col(static_cast<Eigen::Index>(k))); });
  return forces;
}

void ConstrainedSolver::Search::offer(const ConstrainedState& state, const Eigen::MatrixXd& to_go, double distance) {
  if (!(distance < error)) return;
  nearest = state;
  left = to_go;
  error = distance;
}

/// Returns what is left to the solution from the nearest state, which becomes the result.
Eigen::MatrixXd ConstrainedSolver::end_at_rounding(const Search& search, ConstrainedResult& result) const {
  result.after = search.nearest;
  result.error = std::max(nearest_error, search.error);
  result.at_rounding = true;
  return search.left;
}

/// Ends a round that has not converged with its last state or the nearest one that was met, by the same estimate of both: the
/// larger of that of the step that is left and of the response to unbalanced forces. Returns what is left.
Eigen::MatrixXd ConstrainedSolver::take_nearest(const Case& c, const Search& search, Eigen::MatrixXd left,
                                                ConstrainedResult& result) const {
  Eigen::MatrixXd all = response(c, -gradient(result.after));
  double error = points_.reach(all);
  if (left.size() == 0 || error > result.error) left = std::move(all);
  error = std::max(result.error, error);
  if (search.error < error) {
    all = response(c, -gradient(search.nearest));
    const double response_error = points_.reach(all);
    if (std::max(search.error, response_error) < error) {
      result.after = search.nearest;
      error = std::max(search.error, response_error);
      left = response_error > search.error ? std::move(all) : search.left;
    }
  }
  result.error = error;
  return left;
}

/// Returns what is left to the solution, if it converges.
Eigen::MatrixXd ConstrainedSolver::alternate(const Case& c, int most, Search& search, ConstrainedResult& result) const {
  ConstrainedState& now = result.after;
  Anderson window;
  std::vector<Vec3> from = now.targets;  // what the last global step went towards
  bool accelerated = false;
  double check_below = HUGE_VAL;  // step at which it is worth asking again how far the fixed point is
  double least = HUGE_VAL;        // step
  int idle = 0;                   // iterations without a smaller one
  while (result.iterations < most) {
    c.context.check();
    ConstrainedState next;
    next.v = global_step_.solve({}, differences(from, c.unconstrained), c.context);
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
    const double step = rms(differences(from, now.targets));
    if (step == 0 || (window.size() > 0 && rho < 1 && step * rho / (1 - rho) <= options_.tolerance && step <= check_below)) {
      // The cheaper estimate first. It leaves the shapes out, which may curve the objective downwards: then more is left.
      result.error = points_.reach(response(c, points_.weighted_sums(differences(now.targets, from))));
      if (result.error <= options_.tolerance) {
        const Direction left = linearized_direction(now, c.context);
        result.error = std::max(result.error, points_.reach(left.v));
        if (left.end == GradientsEnd::converged) search.offer(now, left.v, result.error);
        if (result.error <= options_.tolerance && left.end == GradientsEnd::converged) {
          result.converged = true;
          return left.v;
        }
        result.error = std::max(result.error, options_.tolerance);
      }
      check_below = step * std::max(0.1, std::min(0.9, options_.tolerance / result.error));
    }
    idle = step < 0.9 * least ? 0 : idle + 1;
    least = std::min(least, step);
    if (idle >= most_idle) {
      idle = 0;
      const double forces = points_.reach(response(c, points_.weighted_sums(differences(now.targets, from))));
      const Direction left = linearized_direction(now, c.context);
      if (left.end == GradientsEnd::converged) search.offer(now, left.v, std::max(forces, points_.reach(left.v)));
      if (search.error <= as_converged) return end_at_rounding(search, result);
    }
    accelerated = window.size() > 0;
    from = accelerated ? window.next() : now.targets;
  }
  return {};
}

/// Fits start from the shapes before, so that points may pass from one side of a shape to the other, where another minimum of
/// the fit is nearer: a sphere that curves the other way. Takes shapes that are clearly nearer than those of a converged state,
/// from which it is no longer converged; the objective falls.
bool ConstrainedSolver::take_nearer_shapes(const Case& c, ConstrainedResult& result) const {
  constexpr double clearly = 1e-6;  // of the squares of a set, and of the objective
  if (!result.converged && !result.at_rounding) return false;
  ConstrainedState fresh;
  fresh.v = result.after.v;
  evaluate(c, fresh);
  bool any = false;
  for (std::size_t t = 0; t < sets().size(); ++t) {
    const double gain = result.after.squares[t] - fresh.squares[t];
    const bool nearer = gain > clearly * result.after.squares[t] &&
                        points_.weight_per_point(t) * gain > clearly * std::abs(result.after.objective);
    if (!nearer) fresh.shapes[t] = result.after.shapes[t];
    any = any || nearer;
  }
  if (!any) return false;
  evaluate(c, fresh);
  result.after = std::move(fresh);
  result.objectives.push_back(result.after.objective);
  result.converged = result.at_rounding = false;
  return true;
}

ConstrainedResult ConstrainedSolver::solve(const Eigen::MatrixXd& h, const std::vector<Vec3>& offsets, const RunContext& context,
                                           const ConstrainedStart* start_from) const {
  const EnergySolver::Problem& problem = solver_.problem();
  ConstrainedResult result;
  const std::vector<Vec3> moved = points_.stretched(offsets);
  Eigen::MatrixXd loads = solver_.loads(h, context);
  Eigen::MatrixXd free;  // the solution without constraints
  Case c{{}, context};
  const auto start = [&] {
    free = solver_.solve_loads(loads, context);
    c.unconstrained = points_.displacements_of_all(free);
    for (std::size_t t = 0; t < sets().size(); ++t) {
      const std::vector<Vec3>& rest = sets()[t].solved_rest();
      for (std::size_t i = points_.first(t); i < points_.first(t + 1); ++i) {
        for (std::size_t k = 0; k < 3; ++k) c.unconstrained[i][k] += rest[i - points_.first(t)][k] + moved[i][k];
      }
    }
  };
  start();
  result.free = free;
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
  const bool multipliers = problem.enforcement == HandleEnforcement::multipliers;
  const double wanted = round_accuracy * (h.size() > 0 ? h.cwiseAbs().maxCoeff() : 0.0);
  Search search;
  const bool newton_too = gauss_newton_.form() != NewtonForm::none;
  const auto ended = [&] { return result.converged || result.at_rounding; };
  double earlier = 0;  // error
  bool rounded = false;
  for (int round = 1;; ++round) {
    result.converged = result.at_rounding = false;
    result.error = 0;
    result.objectives.clear();
    search.restart();
    Eigen::MatrixXd left;
    if (near && newton_too) left = newton(c, search, result);
    for (int refits = 0; refits == 0 || (refits <= most_refits && take_nearer_shapes(c, result)); ++refits) {
      if (refits > 0) search.restart();
      while (!ended() && result.iterations < options_.most_iterations) {
        const int last = newton_too ? result.iterations + patience_ : options_.most_iterations;
        left = alternate(c, std::min(options_.most_iterations, last), search, result);
        if (!ended() && newton_too) left = newton(c, search, result);
      }
    }
    if (!ended()) left = take_nearest(c, search, std::move(left), result);
    rounded = rounded || result.at_rounding;
    result.at_rounding = rounded && ended();
    result.converged = result.converged && !rounded;
    Eigen::MatrixXd both(left.rows(), 6);
    both << result.after.v, left;
    both = reduced_.extended(both, context);
    result.w = free + both.leftCols(3);
    result.left.emplace_back(both.rightCols(3));
    // What a round leaves is in the loads of the next one.
    result.error += earlier;
    earlier = result.error;
    if (!multipliers || round == rounds) return result;
    const Eigen::MatrixXd missing = h - problem.coupling.transpose() * result.w;
    if (missing.size() == 0 || missing.cwiseAbs().maxCoeff() <= wanted) return result;
    if (!ended()) {  // no rounds follow, but what they would change is left as well
      result.left.push_back(solver_.solve_loads(missing, context));
      return result;
    }
    result.rounds.push_back(result.after);
    loads += missing;
    start();
    evaluate(c, result.after);
    near = true;
  }
}

/// Half the gradient of the objective.
Eigen::MatrixXd ConstrainedSolver::gradient(const ConstrainedState& at) const {
  return reduced_.times(at.v) + points_.weighted_sums(differences(at.points, at.targets));
}

ConstrainedSolver::NewtonMatrix ConstrainedSolver::newton_at(const ConstrainedState& at, const RunContext& context) const {
  return gauss_newton_.at(at.points, at.shapes, context);
}

/// The Hessian of half the squared distance from a shape is I - P'. The matrix of an earlier step is reused as preconditioner as
/// long as few iterations suffice, because computing a new one dominates the cost of a step.
ConstrainedSolver::Direction ConstrainedSolver::newton_direction(const ConstrainedState& at, NewtonMatrix& matrix,
                                                                 const RunContext& context) const {
  const Eigen::MatrixXd force = -gradient(at);
  Direction result;
  if (matrix != nullptr) {
    result.v = solve_linearized(at, matrix.get(), force, direction_accuracy, context, most_with_old_matrix, &result.end);
  }
  if (matrix == nullptr || result.end == GradientsEnd::limit) {
    matrix.reset();  // so that there are never two, which take most of the memory of a design
    matrix = newton_at(at, context);
    result.v = solve_linearized(at, matrix.get(), force, direction_accuracy, context, most_gradient_steps, &result.end);
  }
  result.gain = force.cwiseProduct(result.v).sum();
  return result;
}

/// The same without a matrix of its own.
ConstrainedSolver::Direction ConstrainedSolver::linearized_direction(const ConstrainedState& at,
                                                                     const RunContext& context) const {
  Direction result;
  result.v = solve_linearized(at, nullptr, -gradient(at), direction_accuracy, context, most_gradient_steps, &result.end);
  return result;
}

/// Steps as long as they lower the objective, or change it by less than its rounding and come nearer; converged when two in a row
/// move the sets by less than the tolerance. The second is not made but returned: it is what is left. A direction that is cut
/// short, for instance where the objective curves downwards, says nothing: the alternation goes on from there.
Eigen::MatrixXd ConstrainedSolver::newton(const Case& c, Search& search, ConstrainedResult& result) const {
  ConstrainedState& now = result.after;
  bool near = false;  // the last step was that small
  int idle = 0;       // steps in a row that came no nearer, by half
  Eigen::MatrixXd left;
  for (int step = 0; step < most_steps && result.newton_steps < most_steps_of_a_design; ++step) {
    c.context.check();
    const Direction direction = newton_direction(now, search.matrix, c.context);
    left = direction.v;
    const double moved = points_.reach(left);
    result.error = std::max(nearest_error, moved);
    const bool small = moved <= std::max(options_.tolerance, near ? nearest_error : 0.0);
    if (small && direction.end != GradientsEnd::converged) return left;
    result.converged = small && near;
    if (result.converged) return left;
    near = small;
    const bool rounding = direction.gain <= rounding_of_objective * std::abs(now.objective);
    if (direction.end == GradientsEnd::converged) {
      idle = rounding && moved > 0.5 * search.error ? idle + 1 : 0;
      search.offer(now, left, moved);
      if (idle >= most_idle_steps) return end_at_rounding(search, result);
    }
    // Such a step is made whatever the objective says.
    const bool blind = rounding && !near && direction.end == GradientsEnd::converged;
    ++result.newton_steps;
    double share = 1;
    bool lower = false;
    for (int halving = 0; halving < most_halvings && !lower; ++halving, share /= 2) {
      ConstrainedState next;
      next.v = now.v + share * direction.v;
      next.shapes = now.shapes;
      evaluate(c, next);
      lower = next.objective < now.objective;
      if (lower) result.objectives.push_back(next.objective);
      if (lower || blind) now = std::move(next);
      if (blind) break;
    }
    if (lower || blind) continue;
    result.converged = near;
    return left;
  }
  return left;
}

/// dx - P'(x) dx: how the vectors from the projections to the points change.
std::vector<Vec3> ConstrainedSolver::residual_change(const ConstrainedState& at, const std::vector<Vec3>& dx) const {
  return points_.projection_residual_change(at.points, at.shapes, dx);
}

/// (S + sum g Phi^T (I - P') Phi) x = b by conjugate gradients. The preconditioner is the Gauss-Newton matrix, which lacks only
/// the curvature of the shapes, or if that is too expensive the matrix of the global step. Stores in *end, if given, how
/// the iteration ended.
Eigen::MatrixXd ConstrainedSolver::solve_linearized(const ConstrainedState& at, const GaussNewton::Matrix* newton,
                                                    const Eigen::MatrixXd& b, double accuracy, const RunContext& context,
                                                    int most, GradientsEnd* end) const {
  const auto preconditioned = [&](const Eigen::MatrixXd& r) {
    return newton ? newton->inverse(r) : global_step_.solve(r, {}, context);
  };
  const auto product = [&](const Eigen::MatrixXd& p) -> Eigen::MatrixXd {
    return reduced_.times(p) + points_.weighted_sums(residual_change(at, points_.displacements(p)));
  };
  const auto result = conjugate_gradients(b, product, preconditioned, accuracy, most, context);
  if (end != nullptr) *end = result.end;
  // At an indefinite direction the current iterate is the best available result.
  return result.end == GradientsEnd::indefinite && result.iterations == 0 ? preconditioned(b) : result.x;
}

/// The solution of the linearized problem for a right-hand side b of all coefficients: a = A^-1 b, corrected by y - a for the
/// coefficients that reach the sets, where (S + D) y = S a. Symmetric in b. Where points are those that are delivered, they also
/// move by offsets, and the correction is the response to the forces that both cause.
Eigen::MatrixXd ConstrainedSolver::linearized_solution(const ConstrainedState& at, const Eigen::MatrixXd& b,
                                                       const RunContext& context, const std::vector<Vec3>* offsets) const {
  const auto newton = newton_at(at, context);
  if (points_.dense() != nullptr) {
    const Eigen::MatrixXd a = solver_.inverse(b, context);
    std::vector<Vec3> dx = points_.displacements_of_all(a);
    for (std::size_t i = 0; offsets != nullptr && i < dx.size(); ++i) dx[i] = dx[i] + (*offsets)[i];
    // These forces are those of the shapes, which may be much stiffer than the energy: what is left of them counts for the
    // energy.
    constexpr int refinements = 2;
    Eigen::MatrixXd left = -points_.weighted_sums(residual_change(at, dx));
    Eigen::MatrixXd v = Eigen::MatrixXd::Zero(left.rows(), left.cols());
    for (int step = 0; step <= refinements; ++step) {
      const Eigen::MatrixXd change = solve_linearized(at, newton.get(), left, whole_accuracy, context);
      v += change;
      left -= reduced_.times(change) + points_.weighted_sums(residual_change(at, points_.displacements(change)));
    }
    return a + reduced_.extended(v, context);
  }
  if (!reduced_.dense()) return solve_linearized(at, newton.get(), b, whole_accuracy, context);
  const Eigen::MatrixXd a = solver_.inverse(b, context), chosen = reduced_.restricted(a);
  const Eigen::MatrixXd y = solve_linearized(at, newton.get(), reduced_.times(chosen), whole_accuracy, context);
  return a + reduced_.extended(y - chosen, context);
}

/// Adds (I - P')^T G dx, times the sign.
void ConstrainedSolver::add_to_offsets(const ConstrainedState& at, const std::vector<Vec3>& dx, double sign,
                                       std::vector<Vec3>& offsets) const {
  const std::vector<Vec3> change = residual_change(at, dx);
  for (std::size_t t = 0; t < sets().size(); ++t) {
    const double factor = sign * points_.weight_per_point(t);
    for (std::size_t i = points_.first(t); i < points_.first(t + 1); ++i) offsets[i] = offsets[i] + factor * change[i];
  }
}

Eigen::MatrixXd ConstrainedSolver::derivative(const ConstrainedResult& at, const Eigen::MatrixXd& dh,
                                              const std::vector<Vec3>& offsets, const RunContext& context) const {
  const std::vector<Vec3> moved = points_.stretched(offsets);
  Eigen::MatrixXd loads = solver_.loads(dh, context);
  const auto solution = [&](const ConstrainedState& round) {
    return linearized_solution(round, solver_.right_side(loads), context, &moved);
  };
  for (const ConstrainedState& round : at.rounds) loads += dh - solver_.problem().coupling.transpose() * solution(round);
  const Eigen::MatrixXd w = solution(at.after);
  if (solver_.problem().enforcement != HandleEnforcement::eliminated) return w;
  // The effect of the offsets on the distances acts like a force.
  const Eigen::MatrixXd force = points_.weighted_sums(residual_change(at.after, moved));
  const auto newton = newton_at(at.after, context);
  return w - reduced_.extended(solve_linearized(at.after, newton.get(), force, whole_accuracy, context), context);
}

/// Without multipliers w = G R dh - E H^-1 Phi^T g (I - P') offsets with a symmetric G. With them w = G_n (R u_n - F_n offsets),
/// u_0 = p(dh) of the unconstrained solution and u_i+1 = u_i + dh - B G_i (R u_i - F_i offsets) at the end of round i, with R =
/// B^T W and, for delivered points, F_i = Phi^T g (I - P'). W C_i with C_i = B G_i R is symmetric, so the transpose with respect
/// to h is W times the same steps backwards, from B G_n g, and each step gives back its part of the offsets.
ConstrainedSolver::Adjoint ConstrainedSolver::adjoint(const ConstrainedResult& at, const Eigen::MatrixXd& g,
                                                      const RunContext& context) const {
  const EnergySolver::Problem& problem = solver_.problem();
  const bool delivered = points_.dense() != nullptr;
  Eigen::MatrixXd back = linearized_solution(at.after, g, context);
  Eigen::MatrixXd x = problem.coupling.transpose() * back;
  Adjoint result{x, std::vector<Vec3>(points_.count(), Vec3{})};
  if (problem.enforcement == HandleEnforcement::eliminated) {
    const auto newton = newton_at(at.after, context);
    const Eigen::MatrixXd b = reduced_.dense() ? reduced_.times(reduced_.restricted(solver_.inverse(g, context))) : g;
    const Eigen::MatrixXd v = solve_linearized(at.after, newton.get(), b, whole_accuracy, context);
    add_to_offsets(at.after, points_.displacements(v), -1, result.offsets);
    result.offsets = points_.stretched_adjoint(std::move(result.offsets));
    return result;
  }
  if (delivered) add_to_offsets(at.after, points_.displacements_of_all(back), -1, result.offsets);
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(x.rows(), x.cols());
  for (auto round = at.rounds.rbegin(); round != at.rounds.rend(); ++round) {
    sum += x;
    back = linearized_solution(*round, solver_.right_side(x), context);
    x -= problem.coupling.transpose() * back;
    if (delivered) add_to_offsets(*round, points_.displacements_of_all(back), 1, result.offsets);
  }
  result.h = problem.weights.asDiagonal() * (sum + solver_.loads(x, context));
  result.offsets = points_.stretched_adjoint(std::move(result.offsets));
  return result;
}

}  // namespace deform
