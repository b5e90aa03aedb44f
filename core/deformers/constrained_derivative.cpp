// Derivatives of constrained solutions by the implicit function theorem.
#include <cmath>

#include "core/deformers/constrained_newton.h"

namespace deform {

namespace {

constexpr double accuracy = 1e-11;  // of the right-hand side
constexpr int most_iterations = 1000;

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
/// curvature of the shapes only, where it can be afforded; else the matrix of the global step.
Eigen::MatrixXd ConstrainedSolver::solve_linearized(const ConstrainedState& at, const Newton* newton, const Eigen::MatrixXd& b,
                                                    const RunContext& context) const {
  const auto preconditioned = [&](const Eigen::MatrixXd& r) { return newton ? newton->inverse(r) : solve_bordered(r, {}, context); };
  Eigen::MatrixXd x = Eigen::MatrixXd::Zero(b.rows(), 3), residual = b;
  Eigen::MatrixXd z = preconditioned(residual), p = z;
  double rz = residual.cwiseProduct(z).sum();
  const double wanted = accuracy * std::sqrt(std::abs(rz));
  for (int i = 0; i < most_iterations && std::sqrt(std::abs(rz)) > wanted; ++i) {
    context.check();
    const Eigen::MatrixXd Hp = reduced_.times(p) + weighted_transposed(unmet(at, rows_times(p)));
    const double curvature = p.cwiseProduct(Hp).sum();
    if (!(curvature > 0)) break;  // not a minimum: what there is so far is the best that can be said
    const double alpha = rz / curvature;
    x += alpha * p;
    residual -= alpha * Hp;
    z = preconditioned(residual);
    const double next = residual.cwiseProduct(z).sum();
    p = z + (next / rz) * p;
    rz = next;
  }
  return x;
}

/// The solution of the linearized problem for a right-hand side of all coefficients: a = A^-1 b, moved where the sets resist by
/// y - a, (S + D) y = S a. Symmetric in b.
Eigen::MatrixXd ConstrainedSolver::linearized_solution(const ConstrainedState& at, const Newton* newton, const Eigen::MatrixXd& b,
                                                       const RunContext& context) const {
  if (!reduced_.dense()) return solve_linearized(at, newton, b, context);
  const Eigen::MatrixXd a = solver_.inverse(b, context), chosen = reduced_.picked(a);
  const Eigen::MatrixXd y = solve_linearized(at, newton, reduced_.times(chosen), context);
  return a + reduced_.extended(y - chosen, context);
}

Eigen::MatrixXd ConstrainedSolver::derivative(const ConstrainedState& at, const Eigen::MatrixXd& dh,
                                              const std::vector<Vec3>& offsets, const RunContext& context) const {
  const auto newton = newton_at(at, context);
  // What the offsets do to the distances acts like a force.
  const Eigen::MatrixXd force = weighted_transposed(unmet(at, offsets));
  const Eigen::MatrixXd pushed = reduced_.extended(solve_linearized(at, newton.get(), force, context), context);
  Eigen::MatrixXd loads = solver_.loads(dh, context);
  const int steps = solver_.problem().hold == Hold::multipliers ? rounds : 1;
  for (int step = 1;; ++step) {
    const Eigen::MatrixXd w = linearized_solution(at, newton.get(), solver_.right_side(loads), context) - pushed;
    if (step == steps) return w;
    loads += dh - solver_.problem().coupling.transpose() * w;
  }
}

/// Without multipliers w = G R dh - E H^-1 Phi^T g (I - P') offsets with a symmetric G. With them (no offsets then) w = G R u_n,
/// u_0 = p(dh) of the unconstrained solution and u_i = u_i-1 + dh - C u_i-1, C = B G R and R = B^T W. W C is symmetric, so the
/// transpose is W times the same steps, from B G g.
ConstrainedSolver::Adjoint ConstrainedSolver::adjoint(const ConstrainedState& at, const Eigen::MatrixXd& g,
                                                      const RunContext& context) const {
  const EnergySolver::Problem& problem = solver_.problem();
  const auto newton = newton_at(at, context);
  const auto response = [&](const Eigen::MatrixXd& b) -> Eigen::MatrixXd {
    return problem.coupling.transpose() * linearized_solution(at, newton.get(), b, context);
  };
  Eigen::MatrixXd x = response(g);
  Adjoint result{x, std::vector<Vec3>(first_.back(), Vec3{})};
  if (problem.hold == Hold::eliminated) {
    const Eigen::MatrixXd b = reduced_.dense() ? reduced_.times(reduced_.picked(solver_.inverse(g, context))) : g;
    result.offsets = unmet(at, rows_times(solve_linearized(at, newton.get(), b, context)));
    for (std::size_t t = 0; t < sets_.size(); ++t) {
      for (std::size_t i = first_[t]; i < first_[t + 1]; ++i) {
        for (double& value : result.offsets[i]) value *= -per_point(t);
      }
    }
    return result;
  }
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(x.rows(), x.cols());
  for (int round = 1; problem.hold == Hold::multipliers && round < rounds; ++round) {
    sum += x;
    x -= response(solver_.right_side(x));
  }
  result.h = problem.weights.asDiagonal() * (sum + solver_.loads(x, context));
  return result;
}

}  // namespace deform
