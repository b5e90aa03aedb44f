#include "core/deformers/constrained/constrained_newton.h"

#include <algorithm>
#include <cmath>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/numerics/dense/lapack.h"

namespace deform {

namespace {

using Entry = Eigen::Triplet<double, std::int64_t>;
constexpr std::size_t few_points = 64;  // of a set whose parameters are eliminated first
constexpr double direction_accuracy = 1e-3;
constexpr int most_with_old_matrix = 12;  // iterations; a new matrix costs about as much or more
constexpr int most_steps = 30, most_halvings = 10, most_steps_of_a_design = 100;
constexpr double damping = 1e-9;  // of the diagonal: parameters that change nothing stay

}  // namespace

ConstrainedSolver::Newton::Newton(const ConstrainedSolver& solver, const ConstrainedState& at, const RunContext& context)
    : solver_(solver) {
  functions_ = 3 * static_cast<std::int64_t>(solver_.reduced_.size());
  read_shapes(at, context);
  if (solver_.newton_form_ == NewtonForm::forces) {
    make_forces(context);
  } else if (solver_.newton_form_ == NewtonForm::full) {
    make_full(context);
  } else {
    make_sparse(context);
  }
}

void ConstrainedSolver::Newton::read_shapes(const ConstrainedState& at, const RunContext& context) {
  const std::size_t sets = solver_.sets_.size();
  linear_.resize(sets);
  parallel_for(context, sets, 64, [&](std::size_t begin, std::size_t end) {
    for (std::size_t t = begin; t < end; ++t) {
      linear_[t] =
          solver_.sets_[t].projection->linearize({at.points.data() + solver_.first_[t], solver_.set_size(t)}, at.shapes[t]);
    }
  });
  size_ = functions_;
  for (const Linearization& linear : linear_) {
    first_column_.push_back(size_);
    size_ += linear.parameters.cols();
  }
}

void ConstrainedSolver::Newton::add_point(std::size_t point, double root, const Vec3& normal, Row& row) const {
  for (SparseRows::InnerIterator it(solver_.phi_, static_cast<std::int64_t>(point)); it; ++it) {
    for (std::int64_t a = 0; a < 3; ++a) {
      row.columns.push_back(3 * it.col() + a);
      row.values.push_back(root * it.value() * normal[static_cast<std::size_t>(a)]);
    }
  }
}

/// Zeros stay in the rows, so that their pattern does not depend on the state.
template <typename Use>
void ConstrainedSolver::Newton::for_each_row(const Use& use) const {
  Row row;
  for (std::size_t t = 0; t < linear_.size(); ++t) {
    const Linearization& linear = linear_[t];
    const double root = std::sqrt(solver_.per_point(t));
    for (std::size_t r = 0; r < linear.normals.size(); ++r) {
      row.columns.clear();
      row.values.clear();
      add_point(solver_.first_[t] + r / linear.rows_per_point, root, linear.normals[r], row);
      if (!linear.partners.empty()) add_point(solver_.first_[t] + linear.partners[r], root, linear.partner_normals[r], row);
      const auto at = static_cast<Eigen::Index>(r);
      for (Eigen::Index q = 0; q < linear.parameters.cols(); ++q) {
        row.columns.push_back(first_column_[t] + q);
        row.values.push_back(root * linear.parameters(at, q));
      }
      use(row);
    }
  }
}

void ConstrainedSolver::Newton::factor_full() {
  lapack::use_one_thread();
  const auto n = static_cast<int>(full_.rows());
  int info = 0;
  dpotrf_("L", &n, full_.data(), &n, &info);
  if (info == 0) return;
  throw Error(ErrorCode::numerical_failure, "the constraints leave the deformation undetermined at unknown " +
                                                std::to_string(info) + " of " + std::to_string(n));
}

void ConstrainedSolver::Newton::make_full(const RunContext& context) {
  context.check();
  full_ = Eigen::MatrixXd::Zero(size_, size_);
  for_each_row([&](const Row& row) {
    for (std::size_t j = 0; j < row.columns.size(); ++j) {
      if (row.values[j] == 0) continue;
      double* column = full_.col(row.columns[j]).data();
      for (std::size_t i = 0; i < row.columns.size(); ++i) column[row.columns[i]] += row.values[i] * row.values[j];
    }
  });
  const double largest = std::max(full_.diagonal().maxCoeff(), 1e-300);
  for (std::int64_t q = functions_; q < size_; ++q) full_(q, q) += damping * largest;
  const SparseMatrix& S = solver_.reduced_.matrix();
  for (std::int64_t j = 0; j < S.cols(); ++j) {
    for (SparseMatrix::InnerIterator it(S, j); it; ++it) {
      for (std::int64_t a = 0; a < 3; ++a) full_(3 * it.row() + a, 3 * j + a) += it.value();
    }
  }
  factor_full();
  context.check();
}

void ConstrainedSolver::Newton::make_sparse(const RunContext& context) {
  std::vector<Entry> entries;
  std::int64_t rows = 0;
  for_each_row([&](const Row& row) {
    for (std::size_t e = 0; e < row.columns.size(); ++e) entries.emplace_back(rows, row.columns[e], row.values[e]);
    ++rows;
  });
  SparseMatrix J(rows, size_);
  J.setFromTriplets(entries.begin(), entries.end());
  SparseMatrix H = SparseMatrix(SparseMatrix(J.transpose()) * J).triangularView<Eigen::Lower>();
  entries.clear();
  const SparseMatrix& S = solver_.reduced_.matrix();
  for (std::int64_t j = 0; j < S.cols(); ++j) {
    for (SparseMatrix::InnerIterator it(S, j); it; ++it) {
      for (std::int64_t a = 0; a < 3; ++a) entries.emplace_back(3 * it.row() + a, 3 * j + a, it.value());
    }
  }
  const double largest = std::max(H.diagonal().size() > 0 ? H.diagonal().maxCoeff() : 0.0, 1e-300);
  for (std::int64_t q = functions_; q < size_; ++q) entries.emplace_back(q, q, damping * largest);
  SparseMatrix energy(size_, size_);
  energy.setFromTriplets(entries.begin(), entries.end());
  H += energy;
  H.makeCompressed();
  // Parameters of small sets first: they join what is joined already. Those of large ones last: they would join everything.
  std::vector<std::int64_t> order, last;
  for (std::size_t t = 0; t < linear_.size(); ++t) {
    std::vector<std::int64_t>& place = solver_.set_size(t) <= few_points ? order : last;
    for (Eigen::Index q = 0; q < linear_[t].parameters.cols(); ++q) place.push_back(first_column_[t] + q);
  }
  for (std::int64_t i = 0; i < functions_ / 3; ++i) {
    const std::int64_t j = solver_.newton_order_.empty() ? i : solver_.newton_order_[static_cast<std::size_t>(i)];
    for (std::int64_t a = 0; a < 3; ++a) order.push_back(3 * j + a);
  }
  order.insert(order.end(), last.begin(), last.end());
  sparse_ = std::make_unique<const SparseCholesky>(H, order, context);
}

Eigen::VectorXd ConstrainedSolver::Newton::solved(Eigen::VectorXd b) const {
  if (sparse_) {
    sparse_->solve_in_place(b);
    return b;
  }
  return inverse_full(std::move(b));
}

Eigen::MatrixXd ConstrainedSolver::Newton::inverse(const Eigen::MatrixXd& b) const {
  if (solver_.newton_form_ == NewtonForm::forces) {
    Eigen::MatrixXd y = b;
    solver_.reduced_.solve_in_place(y);
    return y - pushed_by(forces_of(distances_of(y)));
  }
  Eigen::VectorXd x = Eigen::VectorXd::Zero(size_);
  for (std::int64_t j = 0; j < b.rows(); ++j) x.segment<3>(3 * j) = b.row(j).transpose();
  x = solved(std::move(x));
  Eigen::MatrixXd result(b.rows(), 3);
  for (std::int64_t j = 0; j < b.rows(); ++j) result.row(j) = x.segment<3>(3 * j).transpose();
  return result;
}

/// Null where it cannot be afforded, or is not positive definite to working precision: the global step's matrix serves then.
ConstrainedSolver::NewtonPtr ConstrainedSolver::newton_at(const ConstrainedState& at, const RunContext& context) const {
  if (newton_form_ == NewtonForm::none) return nullptr;
  try {
    return std::make_shared<const Newton>(*this, at, context);
  } catch (const Error& error) {
    if (error.code() != ErrorCode::numerical_failure) throw;
    return nullptr;
  }
}

/// The Hessian of half the squared distance from a shape is I - P'. The matrix of an earlier step serves as preconditioner as
/// long as few iterations are enough: making one is most of what a step costs.
Eigen::MatrixXd ConstrainedSolver::newton_direction(const ConstrainedState& at, NewtonPtr& matrix,
                                                    const RunContext& context) const {
  std::vector<Vec3> away = at.points;
  for (std::size_t i = 0; i < away.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) away[i][k] -= at.targets[i][k];
  }
  const Eigen::MatrixXd gradient = reduced_.times(at.v) + weighted_transposed(away);
  if (matrix != nullptr) {
    bool finished = true;
    Eigen::MatrixXd direction =
        solve_linearized(at, matrix.get(), -gradient, direction_accuracy, context, most_with_old_matrix, &finished);
    if (finished) return direction;
    matrix = nullptr;
  }
  matrix = newton_at(at, context);
  return solve_linearized(at, matrix.get(), -gradient, direction_accuracy, context);
}

/// Steps as long as they lower the objective; converged when a whole step moves the sets by less than the tolerance.
void ConstrainedSolver::newton(const Case& c, ConstrainedResult& result, NewtonPtr& matrix) const {
  ConstrainedState& now = result.after;
  for (int step = 0; step < most_steps && result.newton_steps < most_steps_of_a_design; ++step) {
    c.context.check();
    const Eigen::MatrixXd direction = newton_direction(now, matrix, c.context);
    ++result.newton_steps;
    const std::vector<Vec3> change = rows_times(direction);
    double moved = 0;
    for (const Vec3& u : change) moved += u[0] * u[0] + u[1] * u[1] + u[2] * u[2];
    moved = std::sqrt(moved / static_cast<double>(std::max<std::size_t>(1, first_.back())));
    double share = 1;
    bool lower = false;
    for (int halving = 0; halving < most_halvings && !lower; ++halving, share /= 2) {
      ConstrainedState next;
      next.v = now.v + share * direction;
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
