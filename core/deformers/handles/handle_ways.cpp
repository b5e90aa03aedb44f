// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/handle_ways.h"

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <variant>

#include "core/base/vectors.h"
#include "core/numerics/dense/decompositions.h"

namespace deform {

namespace {

using Matrix = Eigen::Matrix3d;
using Vector = Eigen::Vector3d;

constexpr double least_angle = 1e-6;  // radians: beyond it an axis can be found to 10 digits

Matrix linear_part(const Affine& motion) {
  Matrix result;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) result(i, j) = motion[static_cast<std::size_t>(4 * i + j)];
  }
  return result;
}

Affine affine(const Matrix& linear, const Vector& shift) {
  Affine result;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) result[static_cast<std::size_t>(4 * i + j)] = linear(i, j);
    result[static_cast<std::size_t>(4 * i + 3)] = shift[i];
  }
  return result;
}

Vector to_eigen(const Vec3& v) { return {v[0], v[1], v[2]}; }
Vec3 from_eigen(const Vector& v) { return {v[0], v[1], v[2]}; }
Vector shift_of(const Affine& motion) { return {motion[3], motion[7], motion[11]}; }

/// 1 + t (M - 1)
Affine straight(const Affine& motion, double t) {
  Affine result;
  for (std::size_t k = 0; k < result.size(); ++k) result[k] = identity_affine[k] + t * (motion[k] - identity_affine[k]);
  return result;
}

Vec3 middle_of(const Mesh& mesh, const std::vector<PointId>& points) {
  Box box;
  for (const PointId id : points) box.add(mesh.points[id]);
  return points.empty() ? Vec3{} : 0.5 * (box.min + box.max);
}

}  // namespace

AffineWay::AffineWay(const Affine& motion, const Vec3& middle) : motion_(motion) {
  const Matrix linear = linear_part(motion);
  if (!(linear.determinant() > 0)) return;
  const auto [values, U, V] = svd(linear);
  const Matrix rotation = U * V.transpose();
  const Matrix stretch = V * values.asDiagonal() * V.transpose();
  const Eigen::AngleAxisd turn{Eigen::Quaterniond(rotation)};
  if (!(turn.angle() > least_angle)) return;
  // The rigid motion behind the stretch about c: y -> R y + b.
  const Vector c = to_eigen(middle), b = shift_of(motion) + linear * c - rotation * c, axis = turn.axis();
  const Vector along = axis.dot(b) * axis, across = b - along;
  Screw screw;
  screw.axis = from_eigen(axis);
  screw.angle = turn.angle();
  screw.shift = from_eigen(along);
  screw.place = from_eigen(0.5 * (across + axis.cross(across) / std::tan(0.5 * turn.angle())));
  screw.stretch = affine(stretch, c - stretch * c);
  screw_ = screw;
}

Affine AffineWay::at(double t) const {
  if (t == 1) return motion_;
  if (!screw_) return straight(motion_, t);
  const Affine stretch = straight(screw_->stretch, t);
  const Matrix rotation = Eigen::AngleAxisd(t * screw_->angle, to_eigen(screw_->axis)).toRotationMatrix();
  const Vector place = to_eigen(screw_->place);
  return affine(rotation * linear_part(stretch), place + rotation * (shift_of(stretch) - place) + t * to_eigen(screw_->shift));
}

HandleWays::HandleWays(const Setup& setup, const SelectedRegions& regions, const Mesh& mesh, const Design& design, Kind kind)
    : setup_(setup), design_(design), ways_(setup.handles.size()), kind_(kind) {
  if (!design.variables.empty()) ends_ = handle_motions(setup, design.variables);
  for (const Motion& motion : design.motions) {
    if (const auto* value = std::get_if<Affine>(&motion.value)) {
      ways_[motion.handle].emplace(*value, middle_of(mesh, regions.handles[motion.handle]));
    }
  }
  if (kind == Kind::straight) return;
  // Both are smooth: where they agree at one place they do so on all of the way.
  const auto natural = motions(0.5);
  kind_ = Kind::straight;
  const auto direct = motions(0.5);
  kind_ = Kind::natural;
  straight_ = natural == direct;
}

std::vector<std::optional<Affine>> HandleWays::motions(double t) const {
  std::vector<std::optional<Affine>> result(setup_.handles.size(), identity_affine);
  if (!design_.variables.empty()) {
    if (kind_ == Kind::natural && t != 1) {
      std::vector<double> values = design_.variables;
      for (double& value : values) value *= t;
      const std::vector<Affine> motions = handle_motions(setup_, values);
      std::copy(motions.begin(), motions.end(), result.begin());
    } else {
      for (std::size_t h = 0; h < ends_.size(); ++h) result[h] = t == 1 ? ends_[h] : deform::straight(ends_[h], t);
    }
  }
  for (const Motion& motion : design_.motions) {
    const auto* value = std::get_if<Affine>(&motion.value);
    result[motion.handle] = value == nullptr          ? std::optional<Affine>()
                            : kind_ == Kind::straight ? deform::straight(*value, t)
                                                      : ways_[motion.handle]->at(t);
  }
  return result;
}

Design HandleWays::design(double t) const {
  Design result;
  result.tolerance = design_.tolerance;
  const auto at_t = motions(t);
  for (std::size_t h = 0; h < at_t.size(); ++h) {
    if (at_t[h] && *at_t[h] != identity_affine) result.motions.push_back({h, *at_t[h]});
  }
  for (const Motion& motion : design_.motions) {
    const auto* displacements = std::get_if<std::vector<Vec3>>(&motion.value);
    if (displacements == nullptr) continue;
    std::vector<Vec3> part = *displacements;
    for (Vec3& u : part) u = t * u;
    result.motions.push_back({motion.handle, std::move(part)});
  }
  return result;
}

}  // namespace deform
