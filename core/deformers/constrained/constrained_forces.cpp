// The Gauss-Newton matrix in the forces of the shapes.
#include <algorithm>
#include <cmath>

#include "core/base/parallel.h"
#include "core/deformers/constrained/constrained_newton.h"

namespace deform {

namespace {

constexpr double damping = 1e-9;  // of the parameters of shapes: what changes nothing stays
constexpr std::size_t rows_per_task = 32;

double dot(const Vec3& a, const Vec3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

}  // namespace

/// Row by row: the point, its normal and the partner's. Calls use(set, row of the set, row of all).
template <typename Use>
void ConstrainedSolver::Newton::for_each_distance(const Use& use) const {
  Eigen::Index all = 0;
  for (std::size_t t = 0; t < linear_.size(); ++t) {
    for (std::size_t r = 0; r < linear_[t].normals.size(); ++r) use(t, r, all++);
  }
}

void ConstrainedSolver::Newton::make_forces(const RunContext& context) {
  context.check();
  Eigen::Index rows = 0;
  for (const Linearization& linear : linear_) rows += linear.residual.size();
  const Eigen::Index parameters = size_ - functions_;
  struct Part {
    Eigen::Index point;
    Vec3 normal;
  };
  std::vector<Part> parts;  // two per row; the second may be nothing
  shapes_ = Eigen::MatrixXd::Zero(rows, parameters);
  full_.resize(rows, rows);
  Eigen::VectorXd softness(rows);  // of the diagonal: 1 / weight
  for_each_distance([&](std::size_t t, std::size_t r, Eigen::Index row) {
    const Linearization& linear = linear_[t];
    const auto at = static_cast<Eigen::Index>(r);
    const auto point = static_cast<Eigen::Index>(solver_.first_[t] + r / linear.rows_per_point);
    parts.push_back({point, linear.normals[r]});
    const bool two = !linear.partners.empty();
    parts.push_back({two ? static_cast<Eigen::Index>(solver_.first_[t] + linear.partners[r]) : point,
                     two ? linear.partner_normals[r] : Vec3{}});
    softness[row] = 1 / solver_.per_point(t);
    const Eigen::Index q = first_column_[t] - functions_;
    shapes_.row(row).segment(q, linear.parameters.cols()) = linear.parameters.row(at);
  });
  const Eigen::MatrixXd& C = solver_.compliance_;
  const bool pairs = std::any_of(linear_.begin(), linear_.end(), [](const Linearization& l) { return !l.partners.empty(); });
  parallel_for(context, static_cast<std::size_t>(rows), rows_per_task, [&](std::size_t begin, std::size_t end) {
    for (std::size_t j = begin; j < end; ++j) {
      const Part &a = parts[2 * j], &b = parts[2 * j + 1];
      for (auto i = j; i < static_cast<std::size_t>(rows); ++i) {
        const Part &c = parts[2 * i], &d = parts[2 * i + 1];
        double value = dot(a.normal, c.normal) * C(c.point, a.point);
        if (pairs) {
          value += dot(a.normal, d.normal) * C(d.point, a.point) + dot(b.normal, c.normal) * C(c.point, b.point) +
                   dot(b.normal, d.normal) * C(d.point, b.point);
        }
        full_(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) = value;
      }
    }
  });
  full_.diagonal() += softness;
  factor_full();
  by_shapes_ = shapes_;
  for (Eigen::Index q = 0; q < parameters; ++q) by_shapes_.col(q) = inverse_full(by_shapes_.col(q));
  Eigen::MatrixXd B = shapes_.transpose() * by_shapes_;
  if (parameters > 0) B.diagonal().array() += damping * std::max(B.diagonal().maxCoeff(), 1e-300);
  of_shapes_.compute(B);
  context.check();
}

Eigen::VectorXd ConstrainedSolver::Newton::inverse_full(Eigen::VectorXd b) const {
  const auto L = full_.triangularView<Eigen::Lower>();
  L.solveInPlace(b);
  L.transpose().solveInPlace(b);
  return b;
}

Eigen::VectorXd ConstrainedSolver::Newton::forces_of(Eigen::VectorXd distances) const {
  Eigen::VectorXd forces = inverse_full(std::move(distances));
  if (shapes_.cols() == 0) return forces;
  return forces - by_shapes_ * of_shapes_.solve(shapes_.transpose() * forces);
}

Eigen::MatrixXd ConstrainedSolver::Newton::pushed_by(const Eigen::VectorXd& forces) const {
  Eigen::MatrixXd b = Eigen::MatrixXd::Zero(functions_ / 3, 3);
  const auto add = [&](std::size_t point, const Vec3& normal, double force) {
    for (SparseRows::InnerIterator it(solver_.phi_, static_cast<std::int64_t>(point)); it; ++it) {
      for (Eigen::Index k = 0; k < 3; ++k) b(it.col(), k) += it.value() * force * normal[static_cast<std::size_t>(k)];
    }
  };
  for_each_distance([&](std::size_t t, std::size_t r, Eigen::Index row) {
    const Linearization& linear = linear_[t];
    add(solver_.first_[t] + r / linear.rows_per_point, linear.normals[r], forces[row]);
    if (!linear.partners.empty()) add(solver_.first_[t] + linear.partners[r], linear.partner_normals[r], forces[row]);
  });
  solver_.reduced_.solve_in_place(b);
  return b;
}

Eigen::VectorXd ConstrainedSolver::Newton::distances_of(const Eigen::MatrixXd& v) const {
  const std::vector<Vec3> moved = solver_.rows_times(v);
  Eigen::VectorXd result(shapes_.rows());
  for_each_distance([&](std::size_t t, std::size_t r, Eigen::Index row) {
    const Linearization& linear = linear_[t];
    result[row] = dot(linear.normals[r], moved[solver_.first_[t] + r / linear.rows_per_point]);
    if (!linear.partners.empty()) {
      result[row] += dot(linear.partner_normals[r], moved[solver_.first_[t] + linear.partners[r]]);
    }
  });
  return result;
}

}  // namespace deform
