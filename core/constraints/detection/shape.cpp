// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/detection/shape.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/numerics/dense/decompositions.h"

namespace deform::detection {

namespace {

using Eigen::Matrix3d;
using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

constexpr double largest_radius = 20;
constexpr double smallest_half_angle = 0.5 * std::numbers::pi / 180;

struct Frame {
  Vector3d e1, e2;
  explicit Frame(const Vector3d& axis) : e1(axis.unitOrthogonal()), e2(axis.cross(e1)) {}
};

int parameter_count(PrimitiveKind kind) {
  switch (kind) {
    case PrimitiveKind::plane:
      return 3;
    case PrimitiveKind::cylinder:
      return 5;
    case PrimitiveKind::sphere:
      return 4;
    case PrimitiveKind::cone:
      return 6;
  }
  return 0;
}

void set_angle(Shape& shape, double angle) {
  shape.angle = angle;
  shape.sine = std::sin(angle);
  shape.cosine = std::cos(angle);
}

/// Derivative of the distance of x: point across the axis (2), axis (2), radius, angle; a sphere: centre (3), radius. Planes are
/// fitted without.
double derivative(const Shape& shape, const Frame& frame, const Vector3d& x, Vector6d& row) {
  row.setZero();
  const Vector3d q = x - shape.point;
  if (shape.kind == PrimitiveKind::sphere) {
    const double length = q.norm();
    if (length > 0) row.head<3>() = -q / length;
    row[3] = -1;
    return length - shape.radius;
  }
  const double h = q.dot(shape.axis);
  const Vector3d across = q - h * shape.axis;
  const double rho = across.norm();
  const Vector3d u = rho > 0 ? Vector3d(across / rho) : frame.e1;
  const double u1 = u.dot(frame.e1), u2 = u.dot(frame.e2);
  const double turn = -(h * shape.cosine + rho * shape.sine);
  row[0] = -shape.cosine * u1;
  row[1] = -shape.cosine * u2;
  row[2] = turn * u1;
  row[3] = turn * u2;
  row[4] = -shape.cosine;
  if (shape.kind == PrimitiveKind::cone) row[5] = -(rho - shape.radius) * shape.sine - h * shape.cosine;
  return (rho - shape.radius) * shape.cosine - h * shape.sine;
}

Shape moved(const Shape& shape, const Frame& frame, const Vector6d& step) {
  Shape result = shape;
  switch (shape.kind) {
    case PrimitiveKind::plane:
      break;
    case PrimitiveKind::sphere:
      result.point += step.head<3>();
      result.radius += step[3];
      break;
    case PrimitiveKind::cylinder:
    case PrimitiveKind::cone:
      result.point += step[0] * frame.e1 + step[1] * frame.e2;
      result.axis = (shape.axis + step[2] * frame.e1 + step[3] * frame.e2).normalized();
      result.radius += step[4];
      if (shape.kind == PrimitiveKind::cone) set_angle(result, shape.angle + step[5]);
      break;
  }
  return result;
}

bool sound(const Shape& shape) {
  if (shape.kind == PrimitiveKind::plane) return true;
  if (!(shape.radius > 0 && shape.radius <= largest_radius)) return false;
  return shape.kind != PrimitiveKind::cone ||
         (shape.angle >= smallest_half_angle && shape.angle <= std::numbers::pi / 2 - smallest_half_angle);
}

double squared_distances(const Shape& shape, const FitData& data) {
  double sum = 0;
  for (std::size_t i = 0; i < data.corners.size(); ++i) {
    const Vector3d q = data.corners[i] - shape.point;
    double d = 0;
    if (shape.kind == PrimitiveKind::plane) {
      d = q.dot(shape.axis);
    } else if (shape.kind == PrimitiveKind::sphere) {
      d = q.norm() - shape.radius;
    } else {
      const double h = q.dot(shape.axis);
      d = ((q - h * shape.axis).norm() - shape.radius) * shape.cosine - h * shape.sine;
    }
    sum += data.corner_weights[i] * d * d;
  }
  return sum;
}

/// Mean and covariance of the normals, of the centres with them, and the mean centre.
struct Moments {
  double weight = 0;
  Vector3d normal = Vector3d::Zero(), centre = Vector3d::Zero();
  Matrix3d normals = Matrix3d::Zero();  ///< not centred, over the weight
};

Moments moments(const FitData& data) {
  Moments m;
  for (std::size_t i = 0; i < data.normals.size(); ++i) {
    const double w = data.weights[i];
    m.weight += w;
    m.normal += w * data.normals[i];
    m.centre += w * data.centres[i];
    m.normals += w * data.normals[i] * data.normals[i].transpose();
  }
  if (m.weight > 0) {
    m.normal /= m.weight;
    m.centre /= m.weight;
    m.normals /= m.weight;
  }
  return m;
}

/// centre - x = -radius n by regression, within the plane across `axis` when there is one. The radius is negative for a bore.
bool regress(const FitData& data, const Moments& m, const Vector3d* axis, Vector3d& centre, double& radius) {
  const auto across = [&](const Vector3d& v) { return axis ? Vector3d(v - v.dot(*axis) * *axis) : v; };
  const Vector3d mean_normal = across(m.normal), mean_centre = across(m.centre);
  double top = 0, bottom = 0;
  for (std::size_t i = 0; i < data.normals.size(); ++i) {
    const Vector3d n = across(data.normals[i]) - mean_normal;
    top += data.weights[i] * n.dot(across(data.centres[i]) - mean_centre);
    bottom += data.weights[i] * n.squaredNorm();
  }
  if (!(bottom > 1e-14 * m.weight)) return false;
  radius = top / bottom;
  centre = mean_centre - radius * mean_normal;
  return true;
}

std::optional<Shape> guess_plane(const FitData& data) {
  double weight = 0;
  Vector3d mean = Vector3d::Zero();
  for (std::size_t i = 0; i < data.corners.size(); ++i) {
    weight += data.corner_weights[i];
    mean += data.corner_weights[i] * data.corners[i];
  }
  if (!(weight > 0)) return std::nullopt;
  mean /= weight;
  Matrix3d spread = Matrix3d::Zero();
  for (std::size_t i = 0; i < data.corners.size(); ++i) {
    const Vector3d q = data.corners[i] - mean;
    spread += data.corner_weights[i] * q * q.transpose();
  }
  const SymmetricEigen<3> eigen = symmetric_eigen(spread);
  Shape shape;
  shape.point = mean;
  shape.axis = eigen.vectors.col(0);
  return shape;
}

std::optional<Shape> guess_cylinder(const FitData& data, const Moments& m) {
  const SymmetricEigen<3> eigen = symmetric_eigen(m.normals);
  Shape shape;
  shape.kind = PrimitiveKind::cylinder;
  shape.axis = eigen.vectors.col(0);
  Vector3d centre;
  double radius = 0;
  if (!regress(data, m, &shape.axis, centre, radius)) return std::nullopt;
  shape.point = centre + m.centre.dot(shape.axis) * shape.axis;
  shape.radius = std::abs(radius);
  return shape;
}

std::optional<Shape> guess_cone(const FitData& data, const Moments& m) {
  Vector3d axis = symmetric_eigen(Matrix3d(m.normals - m.normal * m.normal.transpose())).vectors.col(0);
  // All tangent planes go through the apex.
  Vector3d right = Vector3d::Zero();
  for (std::size_t i = 0; i < data.normals.size(); ++i) {
    right += data.weights[i] / m.weight * data.normals[i].dot(data.centres[i] - m.centre) * data.normals[i];
  }
  const SymmetricEigen<3> tangents = symmetric_eigen(m.normals);
  const Vector3d values = tangents.values;
  if (!(values[0] > 1e-12)) return std::nullopt;
  const Vector3d apex = m.centre + tangents.vectors * (tangents.vectors.transpose() * right).cwiseQuotient(values);
  Vector3d q = m.centre - apex;
  if (q.dot(axis) < 0) axis = -axis;
  const double h = q.dot(axis);
  if (!(h > 0)) return std::nullopt;
  Shape shape;
  shape.kind = PrimitiveKind::cone;
  shape.axis = axis;
  set_angle(shape, std::asin(std::clamp(std::abs(m.normal.dot(axis)), 0.0, 1.0)));
  shape.point = apex + h * axis;
  shape.radius = h * shape.sine / std::max(shape.cosine, 1e-12);
  return shape;
}

}  // namespace

std::optional<Shape> guess(PrimitiveKind kind, const FitData& data) {
  if (kind == PrimitiveKind::plane) return guess_plane(data);
  const Moments m = moments(data);
  if (!(m.weight > 0)) return std::nullopt;
  std::optional<Shape> shape;
  if (kind == PrimitiveKind::cylinder) shape = guess_cylinder(data, m);
  if (kind == PrimitiveKind::cone) shape = guess_cone(data, m);
  if (kind == PrimitiveKind::sphere) {
    Shape sphere;
    sphere.kind = kind;
    if (regress(data, m, nullptr, sphere.point, sphere.radius)) {
      sphere.radius = std::abs(sphere.radius);
      shape = sphere;
    }
  }
  if (shape && !sound(*shape)) return std::nullopt;
  return shape;
}

std::optional<Shape> refine(const Shape& start, const FitData& data, Effort effort) {
  if (start.kind == PrimitiveKind::plane) return guess_plane(data);
  const int n = parameter_count(start.kind);
  if (data.corners.size() < static_cast<std::size_t>(n)) return std::nullopt;
  Shape shape = start;
  double error = squared_distances(shape, data), damping = 1e-6;
  double weight = 0;
  for (const double w : data.corner_weights) weight += w;
  const int rounds = effort == Effort::quick ? 4 : 25;
  const double enough = effort == Effort::quick ? 1e-2 : 1e-9;  // relative gain that is worth another round
  for (int round = 0; round < rounds; ++round) {
    const Frame frame(shape.axis);
    Matrix6d normal = Matrix6d::Zero();
    Vector6d right = Vector6d::Zero(), row;
    for (std::size_t i = 0; i < data.corners.size(); ++i) {
      const double d = derivative(shape, frame, data.corners[i], row);
      const double w = data.corner_weights[i];
      for (int c = 0; c < n; ++c) {
        for (int r = c; r < n; ++r) normal(r, c) += w * row[r] * row[c];
        right[c] -= w * d * row[c];
      }
    }
    bool better = false;
    double gain = 0;
    for (int attempt = 0; attempt < 8 && !better; ++attempt) {
      Matrix6d damped = normal;
      for (int k = 0; k < 6; ++k) damped(k, k) += k < n ? damping * (normal(k, k) + 1e-12 * weight) : weight;
      const Vector6d step = damped.ldlt().solve(right);
      if (!(step.dot(right) > enough * error)) break;
      const Shape next = moved(shape, frame, step);
      const double next_error = sound(next) ? squared_distances(next, data) : error;
      better = next_error < error;
      if (better) {
        gain = error - next_error;
        shape = next;
        error = next_error;
        damping = std::max(damping * 0.1, 1e-12);
      } else {
        damping *= 10;
      }
    }
    if (!better || gain < enough * error || error < 1e-26 * weight) break;
  }
  if (shape.kind == PrimitiveKind::cylinder || shape.kind == PrimitiveKind::cone) {
    // The point beside the middle of the data.
    Vector3d mean = Vector3d::Zero();
    for (std::size_t i = 0; i < data.corners.size(); ++i) mean += data.corner_weights[i] * data.corners[i];
    const double h = (mean / weight - shape.point).dot(shape.axis);
    shape.point += h * shape.axis;
    if (shape.kind == PrimitiveKind::cone) shape.radius += h * shape.sine / shape.cosine;
  }
  if (!sound(shape)) return std::nullopt;
  return shape;
}

std::optional<Shape> fitted(PrimitiveKind kind, const FitData& data, Effort effort) {
  const auto start = guess(kind, data);
  return start ? refine(*start, data, effort) : start;
}

double rms_distance(const Shape& shape, const FitData& data) {
  double weight = 0;
  for (const double w : data.corner_weights) weight += w;
  return weight > 0 ? std::sqrt(squared_distances(shape, data) / weight) : 0;
}

double rms_angle(const Shape& shape, const FitData& data) {
  double weight = 0, sum = 0;
  for (std::size_t i = 0; i < data.normals.size(); ++i) {
    const double c = std::min(1.0, std::abs(shape.foot(data.centres[i]).normal.dot(data.normals[i])));
    const double angle = std::acos(c);
    weight += data.weights[i];
    sum += data.weights[i] * angle * angle;
  }
  return weight > 0 ? std::sqrt(sum / weight) : 0;
}

}  // namespace deform::detection
