// Derivatives of constrained solutions by the implicit function theorem.
#include "core/deformers/constrained/constrained_newton.h"
#include "core/numerics/sparse/conjugate_gradients.h"

namespace deform {

namespace {

constexpr double whole_accuracy = 1e-11;  // of the right-hand side

}  // namespace

/// dx - P'(x) dx: how the distances from the shapes change.
std::vector<Vec3> ConstrainedSolver::unmet(const ConstrainedState& at, const std::vector<Vec3>& dx) const {
  std::vector<Vec3> result(dx.size());
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    const std::size_t first = first_[t], count = first_[t + 1] - first;
    sets_[t].projection->derivative({at.points.data() + first, count}, at.shapes[t], {dx.data() + first, count},
                                    {result.data() + first, count});
  }
  for (std::size_t i = 0; i < dx.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) result[i][k] = dx[i][k] - result[i][k];
  }
  return result;
}

/// (S + sum g Phi^T (I - P') Phi) x = b by conjugate gradients. Preconditioner: the Gauss-Newton matrix, which leaves out the
/// curvature of the shapes only, where it can be afforded; else the matrix of the global step. *finished becomes false
/// where `most` iterations do not reach the accuracy.
Eigen::MatrixXd ConstrainedSolver::solve_linearized(const ConstrainedState& at, const Newton* newton, const Eigen::MatrixXd& b,
                                                    double accuracy, const RunContext& context, int most, bool* finished) const {
  const auto preconditioned = [&](const Eigen::MatrixXd& r) {
    return newton ? newton->inverse(r) : solve_bordered(r, {}, context);
  };
  const auto product = [&](const Eigen::MatrixXd& p) -> Eigen::MatrixXd {
    return reduced_.times(p) + weighted_transposed(unmet(at, rows_times(p)));
  };
  const auto result = conjugate_gradients(b, product, preconditioned, accuracy, most, context);
  if (finished != nullptr) *finished = result.end != GradientsEnd::limit;
  // Not a minimum: what there is so far is the best that can be said.
  return result.end == GradientsEnd::indefinite && result.iterations == 0 ? preconditioned(b) : result.x;
}

/// The solution of the linearized problem for a right-hand side of all coefficients: a = A^-1 b, moved where the sets resist by
/// y - a, (S + D) y = S a. Symmetric in b.
Eigen::MatrixXd ConstrainedSolver::linearized_solution(const ConstrainedState& at, const Eigen::MatrixXd& b,
                                                       const RunContext& context) const {
  const auto newton = newton_at(at, context);
  if (!reduced_.dense()) return solve_linearized(at, newton.get(), b, whole_accuracy, context);
  const Eigen::MatrixXd a = solver_.inverse(b, context), chosen = reduced_.picked(a);
  const Eigen::MatrixXd y = solve_linearized(at, newton.get(), reduced_.times(chosen), whole_accuracy, context);
  return a + reduced_.extended(y - chosen, context);
}

Eigen::MatrixXd ConstrainedSolver::derivative(const ConstrainedResult& at, const Eigen::MatrixXd& dh,
                                              const std::vector<Vec3>& offsets, const RunContext& context) const {
  Eigen::MatrixXd loads = solver_.loads(dh, context);
  for (const ConstrainedState& round : at.rounds) {
    loads += dh - solver_.problem().coupling.transpose() * linearized_solution(round, solver_.right_side(loads), context);
  }
  const Eigen::MatrixXd w = linearized_solution(at.after, solver_.right_side(loads), context);
  if (solver_.problem().hold != Hold::eliminated) return w;
  // What the offsets do to the distances acts like a force.
  const Eigen::MatrixXd force = weighted_transposed(unmet(at.after, offsets));
  const auto newton = newton_at(at.after, context);
  return w - reduced_.extended(solve_linearized(at.after, newton.get(), force, whole_accuracy, context), context);
}

/// Without multipliers w = G R dh - E H^-1 Phi^T g (I - P') offsets with a symmetric G. With them (no offsets then) w = G_n R
/// u_n, u_0 = p(dh) of the unconstrained solution and u_i+1 = u_i + dh - C_i u_i, C_i = B G_i R and R = B^T W at the end of round
/// i. W C_i is symmetric, so the transpose is W times the same steps backwards, from B G_n g.
ConstrainedSolver::Adjoint ConstrainedSolver::adjoint(const ConstrainedResult& at, const Eigen::MatrixXd& g,
                                                      const RunContext& context) const {
  const EnergySolver::Problem& problem = solver_.problem();
  Eigen::MatrixXd x = problem.coupling.transpose() * linearized_solution(at.after, g, context);
  Adjoint result{x, std::vector<Vec3>(first_.back(), Vec3{})};
  if (problem.hold == Hold::eliminated) {
    const auto newton = newton_at(at.after, context);
    const Eigen::MatrixXd b = reduced_.dense() ? reduced_.times(reduced_.picked(solver_.inverse(g, context))) : g;
    result.offsets = unmet(at.after, rows_times(solve_linearized(at.after, newton.get(), b, whole_accuracy, context)));
    for (std::size_t t = 0; t < sets_.size(); ++t) {
      for (std::size_t i = first_[t]; i < first_[t + 1]; ++i) {
        for (double& value : result.offsets[i]) value *= -per_point(t);
      }
    }
    return result;
  }
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(x.rows(), x.cols());
  for (auto round = at.rounds.rbegin(); round != at.rounds.rend(); ++round) {
    sum += x;
    x -= problem.coupling.transpose() * linearized_solution(*round, solver_.right_side(x), context);
  }
  result.h = problem.weights.asDiagonal() * (sum + solver_.loads(x, context));
  return result;
}

}  // namespace deform
