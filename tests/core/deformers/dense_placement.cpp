// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/core/deformers/dense_placement.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

#include "tests/core/deformers/dense_constraints.h"

namespace deform::test::dense_energy {

Places PlacedSet::of(const Places& all) const {
  Places x;
  for (const std::size_t u : places) x.push_back(all[u]);
  return x;
}

Extended PlacedSet::distance(const Places& all) const {
  const Places x = of(all), y = set.projected(x);
  Extended largest = 0;
  for (std::size_t i = 0; i < x.size(); ++i) largest = std::max(largest, (y[i] - x[i]).norm());
  return largest;
}

namespace {

Extended sum_of_squares(const Places& a, const Places& b) {
  Extended sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - b[i]).squaredNorm();
  return sum;
}

}  // namespace

Shape::Shape(const PlacedSet& of, const Places& y) : of_(of), kind_(of.set.kind), round_(kind_), centre_(mean_of(y)) {
  if (const auto* plane = std::get_if<FixedPlane>(&kind_)) {
    for (Eigen::Index k = 0; k < 3; ++k) {
      axis_[k] = plane->normal[static_cast<std::size_t>(k)];
      centre_[k] = plane->point[static_cast<std::size_t>(k)] - of.set.origin[k];
    }
    axis_.normalize();
    return;
  }
  if (is_round()) {
    const Round round = RoundFit(kind_, y, of.set.kept).best();
    centre_ = round.centre;
    axis_ = round.axis;
    radius_ = round.radius;
    angle_ = round.angle;
    for (const auto& section : of.sections) {
      heights_.push_back(0);
      for (const std::size_t i : section) {
        heights_.back() += axis_.dot(y[i] - centre_) / static_cast<Extended>(section.size());
      }
    }
    return;
  }
  const Places on = of.set.projected(y);
  if (std::holds_alternative<Rigid>(kind_)) {
    turn_ = turned(on);
    return;
  }
  if (std::holds_alternative<Spherical>(kind_)) {
    Matrix A(static_cast<Eigen::Index>(on.size()), 4), b(A.rows(), 1);
    for (Eigen::Index i = 0; i < A.rows(); ++i) {
      const Place p = on[static_cast<std::size_t>(i)] - centre_;
      A.row(i) << 2 * p[0], 2 * p[1], 2 * p[2], 1;
      b(i, 0) = p.squaredNorm();
    }
    const Matrix c = least_squares(A, b);
    centre_ += c.topRows(3);
    radius_ = (on[0] - centre_).norm();
    return;
  }
  Eigen::Matrix<Extended, 3, 3> product = Eigen::Matrix<Extended, 3, 3>::Zero();
  for (const Place& p : on) product += (p - centre_) * (p - centre_).transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<Extended, 3, 3>> axes(product);
  axis_ = axes.eigenvectors().col(std::holds_alternative<Straight>(kind_) ? 2 : 0);
}

std::size_t Shape::parameters() const {
  if (std::holds_alternative<FixedPlane>(kind_)) return 0;
  if (std::holds_alternative<Planar>(kind_)) return 3;
  if (is_round()) return first_height() + (std::holds_alternative<Circular>(kind_) ? 1 : heights_.size());
  if (std::holds_alternative<Spherical>(kind_) && of_.set.kept) return 3;
  return std::holds_alternative<Rigid>(kind_) ? 6 : 4;
}

std::vector<Shape::Row> Shape::rows(const Places& y) const {
  std::vector<Row> result;
  const Place first = axis_.unitOrthogonal(), second = axis_.cross(first);
  for (std::size_t i = 0; i < y.size(); ++i) {
    const Place d = y[i] - centre_;
    const Extended h = axis_.dot(d);
    if (std::holds_alternative<FixedPlane>(kind_)) {
      result.push_back({i, h, axis_, {}});
    } else if (std::holds_alternative<Planar>(kind_)) {
      result.push_back({i, h, axis_, {-1, first.dot(d), second.dot(d)}});
    } else if (std::holds_alternative<Straight>(kind_)) {
      result.push_back({i, first.dot(d), first, {-1, 0, -h, 0}});
      result.push_back({i, second.dot(d), second, {0, -1, 0, -h}});
    } else if (std::holds_alternative<Spherical>(kind_)) {
      const Place out = d.normalized();
      std::vector<Extended> by{-out[0], -out[1], -out[2], -1};
      by.resize(parameters());
      result.push_back({i, d.norm() - radius_, out, by});
    } else if (std::holds_alternative<Rigid>(kind_)) {
      const Place at = turn_ * (of_.set.rest[i] - mean_of(of_.set.rest));
      for (Eigen::Index k = 0; k < 3; ++k) {
        const Place unit = Place::Unit(k), moment = unit.cross(at);
        result.push_back({i, d[k] - at[k], unit, {-unit[0], -unit[1], -unit[2], moment[0], moment[1], moment[2]}});
      }
    } else {
      const Place out = (d - h * axis_).normalized();
      const Extended off = (d - h * axis_).norm(), c = std::cos(angle_), sine = std::sin(angle_);
      const Extended along = -c * h / off - sine;
      std::vector<Extended> by{-c * first.dot(out), -c * second.dot(out), along * first.dot(d), along * second.dot(d)};
      if (round_.free_radius()) by.push_back(-c);
      if (round_.free_angle()) by.push_back(-sine * (off - radius_) - c * h);
      by.resize(parameters());
      result.push_back({i, c * (off - radius_) - sine * h, c * out - sine * axis_, by});
      std::vector<Extended> across{0, 0, first.dot(d), second.dot(d)};
      across.resize(parameters());
      if (std::holds_alternative<Circular>(kind_)) {
        across[first_height()] = -1;
        result.push_back({i, h, axis_, across});
      }
      for (std::size_t s = 0; s < of_.sections.size(); ++s) {
        if (std::find(of_.sections[s].begin(), of_.sections[s].end(), i) == of_.sections[s].end()) continue;
        std::vector<Extended> by_height = across;
        by_height[first_height() + s] = -1;
        result.push_back({i, h - heights_[s], axis_, by_height});
      }
    }
  }
  return result;
}

void Shape::change(const std::vector<Extended>& by) {
  const Place first = axis_.unitOrthogonal(), second = axis_.cross(first);
  if (std::holds_alternative<Planar>(kind_)) {
    centre_ += by[0] * axis_;
    axis_ = (axis_ + by[1] * first + by[2] * second).normalized();
  } else if (std::holds_alternative<Straight>(kind_)) {
    centre_ += by[0] * first + by[1] * second;
    axis_ = (axis_ + by[2] * first + by[3] * second).normalized();
  } else if (std::holds_alternative<Spherical>(kind_)) {
    centre_ += Place(by[0], by[1], by[2]);
    if (!of_.set.kept) radius_ += by[3];
  } else if (std::holds_alternative<Rigid>(kind_)) {
    centre_ += Place(by[0], by[1], by[2]);
    const Place axis(by[3], by[4], by[5]);
    if (axis.norm() > 0) turn_ = Eigen::AngleAxis<Extended>(axis.norm(), axis.normalized()).toRotationMatrix() * turn_;
  } else if (is_round()) {
    centre_ += by[0] * first + by[1] * second;
    if (std::holds_alternative<Circular>(kind_)) centre_ += by[first_height()] * axis_;
    axis_ = (axis_ + by[2] * first + by[3] * second).normalized();
    if (round_.free_radius()) radius_ += by[4];
    if (round_.free_angle()) angle_ += by[first_height() - 1];
    for (std::size_t s = 0; s < heights_.size(); ++s) heights_[s] += by[first_height() + s];
  }
}

Eigen::Matrix<Extended, 3, 3> Shape::turned(const Places& on) const {
  const Place before = mean_of(of_.set.rest), now = mean_of(on);
  Eigen::Matrix<Extended, 3, 3> product = Eigen::Matrix<Extended, 3, 3>::Zero();
  for (std::size_t i = 0; i < on.size(); ++i) product += (on[i] - now) * (of_.set.rest[i] - before).transpose();
  const Eigen::JacobiSVD<Eigen::Matrix<Extended, 3, 3>> svd(product, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix<Extended, 3, 3> U = svd.matrixU();
  if ((U * svd.matrixV().transpose()).determinant() < 0) U.col(2) *= -1;
  return U * svd.matrixV().transpose();
}

Placement::Placement(const std::vector<PlacedSet>& sets, const Places& x, const std::vector<bool>& moves) : sets_(sets), x_(x) {
  for (std::size_t u = 0; u < x.size(); ++u) {
    place_.push_back(moves[u] ? static_cast<Eigen::Index>(moving_.size()) : -1);
    if (moves[u]) moving_.push_back(u);
  }
  Box box;
  for (const Place& p : x) box.add({static_cast<double>(p[0]), static_cast<double>(p[1]), static_cast<double>(p[2])});
  size_ = box.diagonal();
}

Placement::Solution Placement::near(Places y) {
  constexpr Extended enough = 1e-16L, bearable = 1e-13L;
  for (const PlacedSet& s : sets_) shapes_.emplace_back(s, s.of(y));
  forces_.assign(static_cast<std::size_t>(residuals(y).rows()), 0);
  Extended last = HUGE_VALL;
  Places best;
  for (int outer = 0; outer < 100; ++outer) {
    const Places before = y;
    if (!run(y)) break;
    const Extended moved = std::sqrt(sum_of_squares(y, before));
    if (moved < last) {
      best = y;
      last = moved;
    }
    if (moved <= enough * size_ || (moved <= bearable * size_ && moved > last)) break;
  }
  if (last > bearable * size_) return {};
  return {best, last};
}

Matrix Placement::residuals(const Places& y, Matrix* slopes) const {
  std::vector<std::vector<Shape::Row>> all;
  Eigen::Index count = 0, columns = points_end();
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    all.push_back(shapes_[t].rows(sets_[t].of(y)));
    count += static_cast<Eigen::Index>(all.back().size());
    columns += static_cast<Eigen::Index>(shapes_[t].parameters());
  }
  Matrix result(count, 1);
  if (slopes != nullptr) *slopes = Matrix::Zero(count, columns);
  Eigen::Index r = 0, first = points_end();
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    for (const Shape::Row& row : all[t]) {
      result(r, 0) = row.value;
      const Eigen::Index m = place_[sets_[t].places[row.point]];
      if (slopes != nullptr && m >= 0) slopes->block(r, 3 * m, 1, 3) = row.by_point.transpose();
      for (std::size_t p = 0; slopes != nullptr && p < row.by_parameters.size(); ++p) {
        (*slopes)(r, first + static_cast<Eigen::Index>(p)) = row.by_parameters[p];
      }
      ++r;
    }
    first += static_cast<Eigen::Index>(shapes_[t].parameters());
  }
  return result;
}

bool Placement::run(Places& y) {
  constexpr Extended weight = 1e6L;
  Extended last = HUGE_VALL;
  bool ended = false;
  for (int step = 0; step < 200 && !ended; ++step) {
    Matrix J;
    const Matrix r = residuals(y, &J);
    Matrix f(r.rows(), 1), g = Matrix::Zero(J.cols(), 1);
    for (Eigen::Index i = 0; i < f.rows(); ++i) f(i, 0) = weight * r(i, 0) + forces_[static_cast<std::size_t>(i)];
    for (std::size_t m = 0; m < moving_.size(); ++m) {
      g.block(static_cast<Eigen::Index>(3 * m), 0, 3, 1) = x_[moving_[m]] - y[moving_[m]];
    }
    g -= product(J.transpose(), f);
    Matrix H = weight * product(J.transpose(), J);
    for (Eigen::Index i = 0; i < H.rows(); ++i) H(i, i) += i < points_end() ? 1 : 1e-12L;
    const Matrix d = ldlt_solution(H, g);
    const Extended length = d.topRows(points_end()).norm();
    if (!std::isfinite(static_cast<double>(length)) || length > 2 * size_) return false;
    for (std::size_t m = 0; m < moving_.size(); ++m) y[moving_[m]] += d.block(static_cast<Eigen::Index>(3 * m), 0, 3, 1);
    Eigen::Index first = points_end();
    for (Shape& shape : shapes_) {
      std::vector<Extended> by;
      for (std::size_t p = 0; p < shape.parameters(); ++p) by.push_back(d(first++, 0));
      shape.change(by);
    }
    ended = length <= 1e-17L * size_ || (length <= 1e-14L * size_ && length > last / 2);
    last = length;
  }
  const Matrix r = residuals(y);
  for (std::size_t i = 0; i < forces_.size(); ++i) forces_[i] += weight * r(static_cast<Eigen::Index>(i), 0);
  return ended;
}

Places carried(const Places& centres, const Places& steps, const Places& at) {
  const auto m = static_cast<Eigen::Index>(centres.size());
  Matrix A = Matrix::Zero(m + 1, m + 1), F = Matrix::Zero(m + 1, 3);
  for (Eigen::Index i = 0; i < m; ++i) {
    for (Eigen::Index j = 0; j < m; ++j) {
      A(i, j) = (centres[static_cast<std::size_t>(i)] - centres[static_cast<std::size_t>(j)]).norm();
    }
    A(i, m) = A(m, i) = 1;
    F.row(i) = steps[static_cast<std::size_t>(i)].transpose();
  }
  const Matrix X = lu_solution(A, F);
  Places values;
  for (const Place& p : at) {
    Place value = X.row(m).transpose();
    for (Eigen::Index j = 0; j < m; ++j) value += (p - centres[static_cast<std::size_t>(j)]).norm() * X.row(j).transpose();
    values.push_back(value);
  }
  return values;
}

}  // namespace deform::test::dense_energy
