// Derivatives of constrained solutions by the implicit function theorem.
#include <cmath>

#include "core/deformers/constrained_solver.h"

namespace deform {

namespace {

constexpr double accuracy = 1e-11;  // of the right-hand side
constexpr int most_iterations = 1000;
constexpr int multiplier_steps = 4;

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

/// (A + sum g Phi^T (I - P') Phi) dw = b by conjugate gradients; the factor of A + sum g Phi^T (I - mean) Phi is the
/// preconditioner.
Eigen::MatrixXd ConstrainedSolver::solve_linearized(const ConstrainedState& at, const Eigen::MatrixXd& b,
                                                    const RunContext& context) const {
  const std::vector<Vec3> nothing(first_.back(), Vec3{});
  Eigen::MatrixXd x = Eigen::MatrixXd::Zero(b.rows(), 3), residual = b;
  Eigen::MatrixXd z = solve_bordered(residual, nothing, context), p = z;
  double rz = residual.cwiseProduct(z).sum();
  const double wanted = accuracy * std::sqrt(std::abs(rz));
  for (int i = 0; i < most_iterations && std::sqrt(std::abs(rz)) > wanted; ++i) {
    context.check();
    const std::vector<Vec3> distances = unmet(at, rows_times(p));
    Eigen::MatrixXd Hp = solver_.matrix().selfadjointView<Eigen::Lower>() * p;
    for (Eigen::Index k = 0; k < 3; ++k) {
      Eigen::VectorXd y(static_cast<Eigen::Index>(distances.size()));
      for (std::size_t j = 0; j < distances.size(); ++j)
        y[static_cast<Eigen::Index>(j)] = distances[j][static_cast<std::size_t>(k)];
      Hp.col(k) += transposed_ * y;
    }
    const double curvature = p.cwiseProduct(Hp).sum();
    if (!(curvature > 0)) break;  // not a minimum: what there is so far is the best that can be said
    const double alpha = rz / curvature;
    x += alpha * p;
    residual -= alpha * Hp;
    z = solve_bordered(residual, nothing, context);
    const double next = residual.cwiseProduct(z).sum();
    p = z + (next / rz) * p;
    rz = next;
  }
  return x;
}

Eigen::MatrixXd ConstrainedSolver::derivative(const ConstrainedState& at, const Eigen::MatrixXd& dh,
                                              const std::vector<Vec3>& offsets, const RunContext& context) const {
  // What the offsets do to the distances acts like a force.
  const std::vector<Vec3> distances = unmet(at, offsets);
  Eigen::MatrixXd force = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(solver_.unknowns()), 3);
  for (Eigen::Index k = 0; k < 3; ++k) {
    Eigen::VectorXd y(static_cast<Eigen::Index>(distances.size()));
    for (std::size_t j = 0; j < distances.size(); ++j)
      y[static_cast<Eigen::Index>(j)] = distances[j][static_cast<std::size_t>(k)];
    force.col(k) = transposed_ * y;
  }
  Eigen::MatrixXd loads = dh;
  const int steps = solver_.problem().hold == Hold::multipliers ? multiplier_steps : 1;
  for (int step = 1;; ++step) {
    const Eigen::MatrixXd w = solve_linearized(at, solver_.right_side(loads) - force, context);
    if (step == steps) return w;
    loads += dh - solver_.problem().coupling.transpose() * w;
  }
}

/// Without multipliers w = H^-1 (R dh - Phi^T g (I - P') offsets), and everything is symmetric. With them (no offsets then) the
/// steps are the same polynomial, see EnergySolver::adjoint().
ConstrainedSolver::Adjoint ConstrainedSolver::adjoint(const ConstrainedState& at, const Eigen::MatrixXd& g,
                                                      const RunContext& context) const {
  const EnergySolver::Problem& problem = solver_.problem();
  Eigen::MatrixXd w = solve_linearized(at, g, context);
  Adjoint result{problem.coupling.transpose() * w, std::vector<Vec3>(first_.back(), Vec3{})};
  if (problem.hold == Hold::eliminated) {
    result.offsets = unmet(at, rows_times(w));
    for (std::size_t t = 0; t < sets_.size(); ++t) {
      for (std::size_t i = first_[t]; i < first_[t + 1]; ++i) {
        for (double& value : result.offsets[i]) value *= -per_point(t);
      }
    }
    return result;
  }
  const Eigen::MatrixXd v = result.h;
  for (int step = 1; problem.hold == Hold::multipliers && step < multiplier_steps; ++step) {
    w = solve_linearized(at, solver_.right_side(result.h), context);
    result.h += v - problem.coupling.transpose() * w;
  }
  result.h = problem.weights.asDiagonal() * result.h;
  return result;
}

}  // namespace deform
