// Gauss-Newton on the coefficients and the parameters of the shapes: for stiff weights and sets that overlap.
#include <algorithm>
#include <cmath>
#include <cstdint>

#include "core/deformers/constrained_solver.h"

namespace deform {

namespace {

using Entry = Eigen::Triplet<double, std::int64_t>;
constexpr std::int64_t most_unknowns = 60000;  // in all coordinates: beyond, a factorization per step costs too much
constexpr int most_steps = 30, most_halvings = 10;
constexpr double damping = 1e-9;  // of the diagonal: parameters that change nothing stay

}  // namespace

/// Change of w: minimum of the quadratic energy plus the squares of the linearized distances.
Eigen::MatrixXd ConstrainedSolver::newton_direction(const Case& c, const ConstrainedState& at) const {
  const auto k = static_cast<std::int64_t>(solver_.unknowns());
  std::vector<Entry> entries;
  std::vector<double> residuals;
  std::int64_t parameters = 0;
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    const std::size_t count = first_[t + 1] - first_[t];
    const Linearization linear = sets_[t].projection->linearize({at.points.data() + first_[t], count}, at.shapes[t]);
    const double root = std::sqrt(per_point(t));
    for (std::size_t r = 0; r < linear.normals.size(); ++r) {
      const auto row = static_cast<std::int64_t>(residuals.size());
      const std::size_t point = first_[t] + r / linear.rows_per_point;
      for (SparseRows::InnerIterator it(phi_, static_cast<std::int64_t>(point)); it; ++it) {
        for (std::int64_t a = 0; a < 3; ++a) {
          entries.emplace_back(row, 3 * it.col() + a, root * it.value() * linear.normals[r][static_cast<std::size_t>(a)]);
        }
      }
      for (Eigen::Index q = 0; q < linear.parameters.cols(); ++q) {
        entries.emplace_back(row, 3 * k + parameters + q, root * linear.parameters(static_cast<Eigen::Index>(r), q));
      }
      residuals.push_back(root * linear.residual[static_cast<Eigen::Index>(r)]);
    }
    parameters += linear.parameters.cols();
  }
  SparseMatrix S(static_cast<std::int64_t>(residuals.size()), 3 * k + parameters);
  S.setFromTriplets(entries.begin(), entries.end());
  const SparseMatrix transposed = S.transpose();
  SparseMatrix H = SparseMatrix(transposed * S).triangularView<Eigen::Lower>();

  entries.clear();
  const SparseMatrix& A = solver_.matrix();
  for (std::int64_t j = 0; j < k; ++j) {
    for (SparseMatrix::InnerIterator it(A, j); it; ++it) {
      for (std::int64_t a = 0; a < 3; ++a) entries.emplace_back(3 * it.row() + a, 3 * j + a, it.value());
    }
  }
  const double largest = std::max(H.diagonal().size() > 0 ? H.diagonal().maxCoeff() : 0.0, 1e-300);
  for (std::int64_t q = 0; q < parameters; ++q) entries.emplace_back(3 * k + q, 3 * k + q, damping * largest);
  SparseMatrix energy(H.rows(), H.cols());
  energy.setFromTriplets(entries.begin(), entries.end());
  H += energy;
  H.makeCompressed();

  const Eigen::MatrixXd gradient = c.base - A.selfadjointView<Eigen::Lower>() * at.w;
  Eigen::VectorXd b =
      -(transposed * Eigen::Map<const Eigen::VectorXd>(residuals.data(), static_cast<Eigen::Index>(residuals.size())));
  for (std::int64_t j = 0; j < k; ++j) {
    for (std::int64_t a = 0; a < 3; ++a) b[3 * j + a] += gradient(j, a);
  }
  SparseCholesky(H, c.context).solve_in_place(b);
  Eigen::MatrixXd direction(k, 3);
  for (std::int64_t j = 0; j < k; ++j) {
    for (std::int64_t a = 0; a < 3; ++a) direction(j, a) = b[3 * j + a];
  }
  return direction;
}

/// Steps as long as they lower the objective; converged when a whole step moves the sets by less than the tolerance.
void ConstrainedSolver::newton(const Case& c, ConstrainedResult& result) const {
  if (3 * static_cast<std::int64_t>(solver_.unknowns()) > most_unknowns) return;
  ConstrainedState& now = result.after;
  for (int step = 0; step < most_steps; ++step) {
    c.context.check();
    const Eigen::MatrixXd direction = newton_direction(c, now);
    ++result.newton_steps;
    double moved = 0;
    for (const Vec3& u : rows_times(direction)) moved += u[0] * u[0] + u[1] * u[1] + u[2] * u[2];
    moved = std::sqrt(moved / static_cast<double>(std::max<std::size_t>(1, first_.back())));
    double share = 1;
    bool lower = false;
    for (int halving = 0; halving < most_halvings && !lower; ++halving, share /= 2) {
      ConstrainedState next;
      next.w = now.w + share * direction;
      next.shapes = now.shapes;
      evaluate(c, next);
      lower = next.objective < now.objective;
      if (lower) now = std::move(next);
    }
    result.error = moved;
    if (moved <= options_.tolerance) result.converged = true;
    if (lower) result.objectives.push_back(now.objective);
    if (result.converged || !lower) return;
  }
}

}  // namespace deform
