// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/core/deformers/dense_constraints.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <stdexcept>
#include <variant>
#include <vector>

#include "core/constraints/constraint.h"
#include "core/deformers/constrained/energy_solver.h"
#include "tests/core/deformers/dense_energy.h"

namespace deform::test::dense_energy {

Place mean_of(const Places& x) {
  Place mean = Place::Zero();
  for (const Place& p : x) mean += p;
  return mean / static_cast<Extended>(x.size());
}

namespace {

struct Ball {
  Place centre;
  Extended radius;
};

/// The nearest sphere, of a radius that may be given: Gauss and Newton's method from the algebraic fit.
Ball ball(const Places& x, const Kept& kept) {
  const auto n = static_cast<Eigen::Index>(x.size());
  const Place mean = mean_of(x);
  Matrix A(n, 4), b(n, 1);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Place p = x[static_cast<std::size_t>(i)] - mean;
    A.row(i) << 2 * p[0], 2 * p[1], 2 * p[2], 1;
    b(i, 0) = p.squaredNorm();
  }
  const Matrix algebraic = least_squares(A, b);
  Place centre = mean + algebraic.topRows(3);
  Extended radius = std::sqrt(algebraic(3, 0) + algebraic.topRows(3).squaredNorm());
  if (kept) {
    centre = mean + (centre - mean) * (*kept / radius);
    radius = *kept;
  }
  for (int step = 0; step < 200; ++step) {
    for (Eigen::Index i = 0; i < n; ++i) {
      const Place from = x[static_cast<std::size_t>(i)] - centre;
      A.row(i) << from.transpose() / from.norm(), 1;
      b(i, 0) = from.norm() - radius;
    }
    const Matrix change = least_squares(A.leftCols(kept ? 3 : 4), b);
    centre += change.topRows(3);
    if (!kept) radius += change(3, 0);
    if (change.norm() <= 1e-18L * radius) break;
  }
  return {centre, radius};
}

Places on_sphere(const Places& x, const Kept& kept) {
  const Ball at = ball(x, kept);
  Places result;
  for (const Place& p : x) result.push_back(at.centre + at.radius * (p - at.centre).normalized());
  return result;
}

}  // namespace

RoundKind::RoundKind(const ConstraintKind& kind)
    : circle(std::holds_alternative<Circular>(kind)), cone(std::holds_alternative<Conical>(kind)) {
  if (const auto* of = std::get_if<Circular>(&kind)) keeps = of->radius == Size::kept;
  if (const auto* of = std::get_if<Cylindrical>(&kind)) keeps = of->radius == Size::kept;
  if (const auto* of = std::get_if<Conical>(&kind)) keeps = of->angle == Size::kept;
}

bool is_round(const ConstraintKind& kind) {
  return std::holds_alternative<Circular>(kind) || std::holds_alternative<Cylindrical>(kind) ||
         std::holds_alternative<Conical>(kind);
}

Extended RoundFit::squares(const Round& at) const {
  Extended sum = 0;
  for (const Place& p : x_) {
    const Place d = p - at.centre;
    const Extended h = at.axis.dot(d), off = (d - h * at.axis).norm() - at.radius;
    const Extended value = std::cos(at.angle) * off - std::sin(at.angle) * h;
    sum += value * value + (kind_.circle ? h * h : 0);
  }
  return sum;
}

Round RoundFit::improved(Round at) const {
  constexpr Extended near = 1e-6L;  // from here the squares tell nothing any more
  Extended now = squares(at), last = HUGE_VALL;
  for (int step = 0; step < 300; ++step) {
    const Place first = at.axis.unitOrthogonal(), second = at.axis.cross(first);
    const Matrix change = step_at(at, first, second);
    const Extended length = change.norm() / at.radius;
    if (length <= near && length >= last) break;
    bool taken = false;
    Extended share = 1;
    for (int halving = 0; halving < 12 && !taken; ++halving, share /= 2) {
      Round next = at;
      next.centre += share * (change(0, 0) * first + change(1, 0) * second + change(2, 0) * at.axis);
      next.axis = (at.axis + share * (change(3, 0) * first + change(4, 0) * second)).normalized();
      next.radius += share * change(5, 0);
      next.angle += share * change(6, 0);
      const Extended then = squares(next);
      taken = length <= near || then < now;
      if (taken) at = next, now = then;
    }
    if (!taken || length <= 1e-18L) break;
    last = length <= near ? length : HUGE_VALL;
  }
  return at;
}

Places RoundFit::nearest(const Round& at) const {
  Places result;
  for (const Place& p : x_) {
    const Place d = p - at.centre;
    const Extended h = at.axis.dot(d), c = std::cos(at.angle), s = std::sin(at.angle);
    const Place out = (d - h * at.axis).normalized();
    const Extended value = c * ((d - h * at.axis).norm() - at.radius) - s * h;
    result.push_back(kind_.circle ? Place(at.centre + at.radius * out) : Place(p - value * (c * out - s * at.axis)));
  }
  return result;
}

Round RoundFit::best() const {
  const Place mean = mean_of(x_);
  Eigen::Matrix<Extended, 3, 3> product = Eigen::Matrix<Extended, 3, 3>::Zero();
  for (const Place& p : x_) product += (p - mean) * (p - mean).transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<Extended, 3, 3>> axes(product);
  std::optional<Round> best;
  std::vector<Place> directions{axes.eigenvectors().col(0)};
  if (kind_.cone) directions.emplace_back(axes.eigenvectors().col(2));
  for (int i = 0; i < 20 && !kind_.circle; ++i) {
    const Extended z = (i + 0.5L) / 20, turn = 2.399963229728653L * i, flat = std::sqrt(1 - z * z);
    directions.emplace_back(flat * std::cos(turn), flat * std::sin(turn), z);
  }
  for (const Place& direction : directions) {
    Round start;
    start.axis = direction;
    const Place first = start.axis.unitOrthogonal(), second = start.axis.cross(first);
    const auto n = static_cast<Eigen::Index>(x_.size());
    Matrix A(n, 3), b(n, 1);
    for (Eigen::Index i = 0; i < n; ++i) {
      const Place d = x_[static_cast<std::size_t>(i)] - mean;
      A.row(i) << 2 * first.dot(d), 2 * second.dot(d), 1;
      b(i, 0) = first.dot(d) * first.dot(d) + second.dot(d) * second.dot(d);
    }
    const Matrix c = least_squares(A, b);
    start.centre = mean + c(0, 0) * first + c(1, 0) * second;
    start.radius = std::sqrt(std::max(Extended{0}, c(2, 0) + c(0, 0) * c(0, 0) + c(1, 0) * c(1, 0)));
    if (kept_ && !kind_.cone) start.radius = *kept_;
    for (const int side : {1, -1}) {
      if (kind_.cone) start.angle = side * kept_.value_or(0.1L);
      if (side < 0 && !kind_.cone) break;
      const Round end = improved(start);
      if (!best || squares(end) < squares(*best)) best = end;
    }
  }
  return *best;
}

Matrix RoundFit::step_at(const Round& at, const Place& first, const Place& second) const {
  const auto n = static_cast<Eigen::Index>(x_.size()), rows = kind_.circle ? 2 * n : n;
  const Extended cosine = std::cos(at.angle), sine = std::sin(at.angle);
  Matrix A = Matrix::Zero(rows, 7), b = Matrix::Zero(rows, 1);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Place d = x_[static_cast<std::size_t>(i)] - at.centre;
    const Extended h = at.axis.dot(d), length = (d - h * at.axis).norm();
    const Place out = (d - h * at.axis).normalized();
    const Extended along = -cosine * h / length - sine;
    A.row(i) << -cosine * first.dot(out), -cosine * second.dot(out), sine, along * first.dot(d), along * second.dot(d), -cosine,
        -sine * (length - at.radius) - cosine * h;
    b(i, 0) = -cosine * (length - at.radius) + sine * h;
    if (!kind_.circle) continue;
    A.row(n + i) << 0, 0, -1, first.dot(d), second.dot(d), 0, 0;
    b(n + i, 0) = -h;
  }
  std::vector<Eigen::Index> free{0, 1, 3, 4};
  if (kind_.circle) free.push_back(2);
  if (kind_.free_radius()) free.push_back(5);
  if (kind_.free_angle()) free.push_back(6);
  Matrix some(rows, static_cast<Eigen::Index>(free.size()));
  for (std::size_t c = 0; c < free.size(); ++c) some.col(static_cast<Eigen::Index>(c)) = A.col(free[c]);
  const Matrix x = least_squares(some, b);
  Matrix result = Matrix::Zero(7, 1);
  for (std::size_t c = 0; c < free.size(); ++c) result(free[c], 0) = x(static_cast<Eigen::Index>(c), 0);
  return result;
}

Kept kept_of(const ConstraintKind& kind, const Places& rest) {
  if (const auto* sphere = std::get_if<Spherical>(&kind)) {
    return sphere->radius == Size::kept ? Kept(ball(rest, {}).radius) : Kept();
  }
  if (!is_round(kind) || !RoundKind(kind).keeps) return {};
  ConstraintKind free = kind;
  if (auto* of = std::get_if<Circular>(&free)) of->radius = Size::free;
  if (auto* of = std::get_if<Cylindrical>(&free)) of->radius = Size::free;
  if (auto* of = std::get_if<Conical>(&free)) of->angle = Size::free;
  const Round at = RoundFit(free, rest, {}).best();
  return std::holds_alternative<Conical>(kind) ? std::abs(at.angle) : at.radius;
}

Places projected(const ConstraintKind& kind, const Kept& kept, const Places& rest, const Places& x, const Place& origin,
                 std::optional<Round>* near) {
  Places result = x;
  if (is_round(kind)) {
    const RoundFit fit(kind, x, kept);
    const Round at = near != nullptr && *near ? fit.improved(**near) : fit.best();
    if (near != nullptr) *near = at;
    return fit.nearest(at);
  }
  if (const auto* plane = std::get_if<FixedPlane>(&kind)) {
    Place normal, point;
    for (Eigen::Index k = 0; k < 3; ++k) {
      normal[k] = plane->normal[static_cast<std::size_t>(k)];
      point[k] = plane->point[static_cast<std::size_t>(k)] - origin[k];
    }
    normal.normalize();
    for (Place& p : result) p -= normal.dot(p - point) * normal;
    return result;
  }
  if (std::holds_alternative<Spherical>(kind)) return on_sphere(x, kept);
  const Place mean = mean_of(x);
  Eigen::Matrix<Extended, 3, 3> product = Eigen::Matrix<Extended, 3, 3>::Zero();
  if (std::holds_alternative<Rigid>(kind)) {  // Kabsch 1976
    const Place before = mean_of(rest);
    for (std::size_t i = 0; i < x.size(); ++i) product += (x[i] - mean) * (rest[i] - before).transpose();
    const Eigen::JacobiSVD<Eigen::Matrix<Extended, 3, 3>> svd(product, Eigen::ComputeFullU | Eigen::ComputeFullV);
    Eigen::Matrix<Extended, 3, 3> turn = svd.matrixU() * svd.matrixV().transpose();
    if (turn.determinant() < 0) {
      Eigen::Matrix<Extended, 3, 3> U = svd.matrixU();
      U.col(2) *= -1;
      turn = U * svd.matrixV().transpose();
    }
    for (std::size_t i = 0; i < x.size(); ++i) result[i] = mean + turn * (rest[i] - before);
    return result;
  }
  for (const Place& p : x) product += (p - mean) * (p - mean).transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<Extended, 3, 3>> axes(product);
  if (std::holds_alternative<Planar>(kind)) {
    const Place normal = axes.eigenvectors().col(0);
    for (Place& p : result) p -= normal.dot(p - mean) * normal;
    return result;
  }
  if (!std::holds_alternative<Straight>(kind)) throw std::logic_error("not a kind that is projected onto here");
  const Place along = axes.eigenvectors().col(2);
  for (Place& p : result) p = mean + along.dot(p - mean) * along;
  return result;
}

Places Set::at(const Field& w) const {
  Places x = rest;
  for (std::size_t i = 0; i < x.size(); ++i) {
    if (!shift.empty()) x[i] += shift[i];
    for (const auto& [j, value] : rows[i]) {
      for (std::size_t k = 0; k < 3; ++k) {
        x[i][static_cast<Eigen::Index>(k)] += value * static_cast<Extended>(w[static_cast<std::size_t>(j)][k]);
      }
    }
  }
  return x;
}

void Set::add_transposed(const Places& v, Field& to) const {
  for (std::size_t i = 0; i < v.size(); ++i) {
    for (const auto& [j, value] : rows[i]) {
      for (std::size_t k = 0; k < 3; ++k) {
        to[static_cast<std::size_t>(j)][k] += Quad(weight * value) * Quad(v[i][static_cast<Eigen::Index>(k)]);
      }
    }
  }
}

Matrix Set::residual_derivative(const Places& x) const {
  const auto n = static_cast<Eigen::Index>(3 * x.size());
  Extended size = 0;
  const Place mean = mean_of(x);
  for (const Place& p : x) size = std::max(size, (p - mean).norm());
  const Extended step = 1e-6L * size;
  Matrix result = Matrix::Identity(n, n);
  dense_energy::projected(kind, kept, rest, x, origin, &last);
  const auto near = [&](const Places& at) {
    std::optional<Round> start = last;
    return dense_energy::projected(kind, kept, rest, at, origin, &start);
  };
  for (Eigen::Index c = 0; c < n; ++c) {
    Places up = x, down = x;
    up[static_cast<std::size_t>(c / 3)][c % 3] += step;
    down[static_cast<std::size_t>(c / 3)][c % 3] -= step;
    const Places above = near(up), below = near(down);
    for (Eigen::Index r = 0; r < n; ++r) {
      const auto i = static_cast<std::size_t>(r / 3);
      result(r, c) -= (above[i][r % 3] - below[i][r % 3]) / (2 * step);
    }
  }
  return result;
}

ConstrainedEquations::Solution ConstrainedEquations::solution(const std::vector<Places>& near) {
  Field u = loads(equations_, factor_, multipliers_);
  b_ = equations_.right_side(u);
  Solution result{start(near)};
  for (int step = 0; step < (multipliers_ ? EnergySolver::multiplier_steps : 1); ++step) {
    if (step > 0) {
      const Field missing = equations_.misfit(result.w);
      for (std::size_t i = 0; i < u.size(); ++i) {
        for (std::size_t k = 0; k < 3; ++k) u[i][k] += missing[i][k];
      }
      b_ = equations_.right_side(u);
    }
    if (!improve(result)) return {};
  }
  return result;
}

bool ConstrainedEquations::improve(Solution& result) const {
  constexpr int most_steps = 14, last_steps = 4;
  Lu<Extended> newton(derivative(result.w));
  Quad before = -1;
  for (int step = 0; step < most_steps; ++step) {
    const Field change = solved(newton, residual(result.w));
    const Quad size = largest(change);
    for (std::size_t j = 0; j < result.w.size(); ++j) {
      for (std::size_t k = 0; k < 3; ++k) result.w[j][k] += change[j][k];
    }
    if (size <= Quad(1e-15) * largest(result.w)) return true;
    if (step >= most_steps - last_steps) result.rounding = std::max(result.rounding, static_cast<Extended>(size));
    if (before >= 0 && size > before / 5 && step < most_steps - last_steps) newton.compute(derivative(result.w));
    before = size;
  }
  return result.rounding <= 1e-6L * static_cast<Extended>(largest(result.w));
}

Field ConstrainedEquations::residual(const Field& w) const {
  Field r = factor_.residual(b_, w);
  for (const Set& set : sets_) {
    Places x = set.at(w);
    const Places y = set.projected(x);
    for (std::size_t i = 0; i < x.size(); ++i) x[i] = y[i] - x[i];
    set.add_transposed(x, r);
  }
  return r;
}

Field ConstrainedEquations::solved(const Lu<Extended>& lu, const Field& r) {
  Matrix right(static_cast<Eigen::Index>(3 * r.size()), 1);
  for (Eigen::Index i = 0; i < right.rows(); ++i) {
    right(i, 0) = static_cast<Extended>(r[static_cast<std::size_t>(i / 3)][static_cast<std::size_t>(i % 3)]);
  }
  const Matrix x = lu.solve(right);
  Field result(r.size());
  for (Eigen::Index i = 0; i < right.rows(); ++i) {
    result[static_cast<std::size_t>(i / 3)][static_cast<std::size_t>(i % 3)] = Quad(x(i, 0));
  }
  return result;
}

Field ConstrainedEquations::start(std::vector<Places> near) const {
  constexpr int more = 300;
  Matrix A = spread(factor_.matrix());
  for (const Set& set : sets_) {
    const auto n = static_cast<Eigen::Index>(3 * set.rest.size());
    add(set, Matrix::Identity(n, n), A);
  }
  const Lu<Extended> lu(A);
  Field w = drawn(lu, near);
  for (int i = 0; multipliers_ && i < more; ++i) {
    for (std::size_t t = 0; t < sets_.size(); ++t) near[t] = sets_[t].at(w);
    w = drawn(lu, near);
  }
  return w;
}

Field ConstrainedEquations::drawn(const Lu<Extended>& lu, const std::vector<Places>& near) const {
  Field b = b_;
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    Places to = sets_[t].projected(near[t]);
    for (std::size_t i = 0; i < to.size(); ++i) {
      to[i] -= sets_[t].rest[i];
      if (!sets_[t].shift.empty()) to[i] -= sets_[t].shift[i];
    }
    sets_[t].add_transposed(to, b);
  }
  return solved(lu, b);
}

Matrix ConstrainedEquations::derivative(const Field& w) const {
  Matrix A = spread(factor_.matrix());
  for (const Set& set : sets_) add(set, set.residual_derivative(set.at(w)), A);
  return A;
}

Matrix ConstrainedEquations::spread(const Matrix& one) {
  Matrix A = Matrix::Zero(3 * one.rows(), 3 * one.rows());
  for (Eigen::Index i = 0; i < one.rows(); ++i) {
    for (Eigen::Index j = 0; j < one.cols(); ++j) {
      for (Eigen::Index k = 0; k < 3; ++k) A(3 * i + k, 3 * j + k) = one(i, j);
    }
  }
  return A;
}

void ConstrainedEquations::add(const Set& set, const Matrix& D, Matrix& A) {
  for (std::size_t i = 0; i < set.rows.size(); ++i) {
    for (std::size_t l = 0; l < set.rows.size(); ++l) {
      for (const auto& [a, x] : set.rows[i]) {
        for (const auto& [b, y] : set.rows[l]) {
          A.block(3 * a, 3 * b, 3, 3) +=
              set.weight * x * y * D.block(static_cast<Eigen::Index>(3 * i), static_cast<Eigen::Index>(3 * l), 3, 3);
        }
      }
    }
  }
}

}  // namespace deform::test::dense_energy
