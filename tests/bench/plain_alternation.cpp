// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/plain_alternation.h"

#include <cmath>

namespace deform::bench {

namespace {

Eigen::MatrixXd matrix_of(const Vec3* points, std::size_t count) {
  Eigen::MatrixXd result(static_cast<Eigen::Index>(count), 3);
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t k = 0; k < 3; ++k) result(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) = points[i][k];
  }
  return result;
}

}  // namespace

PlainAlternation::PlainAlternation(const EnergySolver& solver, const SparseRows& values, const std::vector<ConstraintSet>& sets,
                                   const Eigen::MatrixXd& h, const std::vector<Vec3>& offsets, Form form)
    : form_(form), reduced_(solver, functions_reaching(values, sets), 0, {}), points_(sets, values, reduced_) {
  if (form == Form::translations) {
    translations_ = std::make_unique<const GlobalStep>(points_, reduced_, 0, RunContext{});
  } else {
    Eigen::MatrixXd A = SparseMatrix(reduced_.matrix().selfadjointView<Eigen::Lower>());
    for (std::size_t t = 0; t < sets.size(); ++t) {
      const Eigen::MatrixXd phi =
          points_.phi().middleRows(static_cast<std::int64_t>(points_.first(t)), static_cast<std::int64_t>(points_.size(t)));
      const Eigen::MatrixXd centred = centring(t) * phi;
      A += points_.weight_per_point(t) * centred.transpose() * centred;
    }
    factor_.compute(A);
  }
  free_ = solver.solve(h, {});
  unconstrained_ = points_.displacements(reduced_.restricted(free_));
  for (std::size_t t = 0; t < sets.size(); ++t) {
    for (std::size_t i = 0; i < points_.size(t); ++i) {
      Vec3& x = unconstrained_[points_.first(t) + i];
      for (std::size_t k = 0; k < 3; ++k) x[k] += sets[t].rest[i][k] + offsets[points_.first(t) + i][k];
    }
  }
  state_.v = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(reduced_.size()), 3);
  state_.targets.resize(points_.count());
  state_.shapes.resize(sets.size());
  state_.squares.resize(sets.size());
  project();
}

Eigen::MatrixXd PlainAlternation::centring(std::size_t set) const {
  const auto n = static_cast<Eigen::Index>(points_.size(set));
  Eigen::MatrixXd C = Eigen::MatrixXd::Identity(n, n);
  if (!points_.sets()[set].projection->moves_with_its_points()) return C;
  if (form_ == Form::mean_centred) C.array() -= 1 / static_cast<double>(n);
  if (form_ == Form::anchored) C.col(0).array() -= 1;
  return C;
}

void PlainAlternation::project() {
  state_.points = points_.displacements(state_.v);
  for (std::size_t i = 0; i < state_.points.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) state_.points[i][k] += unconstrained_[i][k];
  }
  state_.objective = state_.v.cwiseProduct(reduced_.times(state_.v)).sum();
  for (std::size_t t = 0; t < state_.shapes.size(); ++t) {
    const std::size_t first = points_.first(t), count = points_.size(t);
    state_.squares[t] = points_.sets()[t].projection->project({state_.points.data() + first, count},
                                                              {state_.targets.data() + first, count}, state_.shapes[t]);
    state_.objective += points_.weight_per_point(t) * state_.squares[t];
  }
}

Eigen::MatrixXd PlainAlternation::global_step(const std::vector<Vec3>& y) const {
  if (translations_) return translations_->solve({}, y, {});
  Eigen::MatrixXd b = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(reduced_.size()), 3);
  for (std::size_t t = 0; t < points_.sets().size(); ++t) {
    const std::size_t first = points_.first(t), count = points_.size(t);
    const Eigen::MatrixXd C = centring(t),
                          phi = points_.phi().middleRows(static_cast<std::int64_t>(first), static_cast<std::int64_t>(count));
    b += points_.weight_per_point(t) * phi.transpose() * (C.transpose() * (C * matrix_of(y.data() + first, count)));
  }
  return factor_.solve(b);
}

double PlainAlternation::step() {
  const std::vector<Vec3> before = state_.targets;
  std::vector<Vec3> y = before;
  for (std::size_t i = 0; i < y.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) y[i][k] -= unconstrained_[i][k];
  }
  state_.v = global_step(y);
  project();
  const double change = (matrix_of(before.data(), before.size()) - matrix_of(state_.targets.data(), before.size())).squaredNorm();
  return std::sqrt(change / static_cast<double>(before.size()));
}

}  // namespace deform::bench
