// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/fit_starts.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/numerics/dense/decompositions.h"

namespace deform {

namespace {

constexpr std::size_t search_points = 200;
constexpr int search_directions = 250;

}  // namespace

PrincipalAxes principal_axes(std::span<const Vec3> x) {
  PrincipalAxes result;
  result.mean = spread({x}).mean;
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const Vec3& p : x) {
    const Eigen::Vector3d d = to_eigen(p) - result.mean;
    scatter.noalias() += d * d.transpose();
  }
  const SymmetricEigen<3> eigen = symmetric_eigen(scatter);
  result.axes = eigen.vectors;
  if (result.axes.determinant() < 0) result.axes.col(0) *= -1;
  result.moments = eigen.values;
  return result;
}

Eigen::Vector3d any_normal_to(const Eigen::Vector3d& n) {
  Eigen::Index least = 0;
  n.cwiseAbs().minCoeff(&least);
  const Eigen::Vector3d e = Eigen::Vector3d::Unit(least);
  return (e - n[least] * n).normalized();
}

Eigen::Matrix3d axes_from(const Eigen::Vector3d& z, const Eigen::Vector3d& x) {
  Eigen::Matrix3d axes;
  const Eigen::Vector3d across = x - z.dot(x) * z;
  const bool usable = across.norm() > 1e-8 * x.norm() && x.norm() > 0;
  axes.col(2) = z;
  axes.col(0) = usable ? across.normalized() : any_normal_to(z);
  axes.col(1) = axes.col(2).cross(axes.col(0));
  return axes;
}

std::vector<Eigen::Vector3d> thinned(std::span<const Vec3> x, std::size_t count) {
  const std::size_t stride = std::max<std::size_t>(1, x.size() / count);
  std::vector<Eigen::Vector3d> few;
  for (std::size_t i = 0; i < x.size(); i += stride) few.push_back(to_eigen(x[i]));
  return few;
}

PlaneCircle algebraic_circle(const std::vector<Eigen::Vector2d>& points) {
  const auto n = static_cast<Eigen::Index>(points.size());
  Eigen::MatrixXd A(n, 3);
  Eigen::VectorXd b(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Eigen::Vector2d& p = points[static_cast<std::size_t>(i)];
    A.row(i) << 2 * p[0], 2 * p[1], 1;
    b[i] = p.squaredNorm();
  }
  const Eigen::Vector3d s = least_solution(A.transpose() * A, A.transpose() * b);
  const double square = s[2] + s.head<2>().squaredNorm();
  return {s.head<2>(), square > 0 ? std::sqrt(square) : 0};
}

AlgebraicSphere algebraic_sphere(const std::vector<Eigen::Vector3d>& points) {
  const auto n = static_cast<Eigen::Index>(points.size());
  Eigen::MatrixXd A(n, 4);
  Eigen::VectorXd b(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Eigen::Vector3d& p = points[static_cast<std::size_t>(i)];
    A.row(i) << 2 * p[0], 2 * p[1], 2 * p[2], 1;
    b[i] = p.squaredNorm();
  }
  const Eigen::Vector4d s = least_solution(A, b);
  const double square = s[3] + s.head<3>().squaredNorm();
  return {s.head<3>(), square > 0 ? std::sqrt(square) : 0};
}

Eigen::Matrix2d patch_curvature(std::span<const Vec3> x, const PrincipalAxes& axes) {
  const auto few = thinned(x, 1000);
  const auto n = static_cast<Eigen::Index>(few.size());
  Eigen::MatrixXd A(n, 6);
  Eigen::VectorXd b(n);
  // Scaled to a set of size one, so that the columns compare.
  const double size = std::sqrt(std::max(axes.moments[2] / static_cast<double>(x.size()), 1e-300));
  for (Eigen::Index i = 0; i < n; ++i) {
    const Eigen::Vector3d y = axes.axes.transpose() * (few[static_cast<std::size_t>(i)] - axes.mean) / size;
    A.row(i) << 1, y[2], y[1], 0.5 * y[2] * y[2], y[2] * y[1], 0.5 * y[1] * y[1];
    b[i] = y[0];
  }
  const Eigen::VectorXd s = least_solution(A, b);
  Eigen::Matrix2d H;
  H << s[3], s[4], s[4], s[5];
  return H / size;
}

std::vector<Eigen::Vector3d> directions(int count, const PrincipalAxes& axes) {
  std::vector<Eigen::Vector3d> all;
  const double golden = std::numbers::pi * (3 - std::sqrt(5.0));
  for (int k = 0; k < count; ++k) {
    const double z = (k + 0.5) / count;
    const double r = std::sqrt(1 - z * z);
    all.emplace_back(r * std::cos(golden * k), r * std::sin(golden * k), z);
  }
  for (int k = 0; k < 3; ++k) all.push_back(axes.axes.col(k));
  return all;
}

namespace {

/// The candidate for one direction; points about their mean.
AxisCandidate candidate(const std::vector<Eigen::Vector3d>& points, const Eigen::Vector3d& direction, Profile profile) {
  const Eigen::Matrix3d axes = axes_from(direction, Eigen::Vector3d::Zero());
  const auto n = static_cast<Eigen::Index>(points.size());
  const Eigen::Index columns = profile == Profile::cylinder ? 3 : 5;
  Eigen::MatrixXd Y(n, 3), A(n, columns);
  for (Eigen::Index i = 0; i < n; ++i) Y.row(i) = axes.transpose() * points[static_cast<std::size_t>(i)];
  A.col(0) = Y.col(0);
  A.col(1) = Y.col(1);
  A.col(2).setOnes();
  if (columns == 5) {
    A.col(3) = Y.col(2);
    A.col(4) = Y.col(2).cwiseAbs2();
  }
  const Eigen::VectorXd b = Y.leftCols<2>().rowwise().squaredNorm();
  const Eigen::VectorXd s = least_solution(A.transpose() * A, A.transpose() * b);
  const Eigen::RowVector2d centre = 0.5 * s.head<2>().transpose();
  const Eigen::VectorXd radii = (Y.leftCols<2>().rowwise() - centre).rowwise().norm();
  AxisCandidate result;
  result.direction = direction;
  result.point = axes * Eigen::Vector3d(centre[0], centre[1], 0);
  result.radius = radii.mean();
  if (profile == Profile::cone) {
    const double square = Y.col(2).squaredNorm();
    if (square > 0) result.slope = Y.col(2).dot(radii) / square;
  }
  const double cosine = 1 / std::hypot(1, result.slope);
  const Eigen::VectorXd away = cosine * (radii - result.slope * Y.col(2)).array() - cosine * result.radius;
  result.energy = away.squaredNorm() / static_cast<double>(n);
  return result;
}

}  // namespace

std::vector<AxisCandidate> axis_candidates(std::span<const Vec3> x, Profile profile, std::size_t count) {
  const PrincipalAxes axes = principal_axes(x);
  auto points = thinned(x, search_points);
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const auto& p : points) mean += p / static_cast<double>(points.size());
  for (auto& p : points) p -= mean;
  std::vector<AxisCandidate> all;
  for (const Eigen::Vector3d& d : directions(search_directions, axes)) all.push_back(candidate(points, d, profile));
  std::stable_sort(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.energy < b.energy; });
  std::vector<AxisCandidate> best;
  for (AxisCandidate& next : all) {
    const bool close = std::any_of(best.begin(), best.end(), [&](const AxisCandidate& b) {
      return std::abs(b.direction.dot(next.direction)) > std::cos(20 * std::numbers::pi / 180);
    });
    if (close) continue;
    next.point += mean;
    best.push_back(next);
    if (best.size() == count) break;
  }
  return best;
}

}  // namespace deform
