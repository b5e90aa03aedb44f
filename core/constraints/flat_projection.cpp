// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/flat_projection.h"

#include <utility>

#include "core/base/vectors.h"

namespace deform {

FlatProjection::FlatProjection(std::shared_ptr<const Projection> of, const Vec3& normal, std::span<const Vec3> rest)
    : of_(std::move(of)), normal_(normal) {
  heights_.reserve(rest.size());
  for (const Vec3& x : rest) heights_.push_back(dot(normal_, x));
}

Vec3 FlatProjection::along(const Vec3& v) const { return v - dot(normal_, v) * normal_; }

double FlatProjection::project(std::span<const Vec3> x, std::span<Vec3> out, ShapeParameters& shape) const {
  const double squares = of_->project(x, out, shape);
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = along(out[i]) + heights_[i] * normal_;
  return squares;
}

Projection::Misfit FlatProjection::misfit(std::span<const Vec3> x, std::span<const Vec3> /*y*/) const {
  std::vector<Vec3> projected(x.size());
  ShapeParameters shape;
  of_->project(x, projected, shape);
  return of_->misfit(x, projected);
}

void FlatProjection::derivative(std::span<const Vec3> x, const ShapeParameters& shape, std::span<const Vec3> dx,
                                std::span<Vec3> out) const {
  std::vector<Vec3> flat(dx.begin(), dx.end());
  for (Vec3& v : flat) v = along(v);
  of_->derivative(x, shape, flat, out);
  for (Vec3& v : out) v = along(v);
}

Linearization FlatProjection::linearize(std::span<const Vec3> x, const ShapeParameters& shape) const {
  Linearization result = of_->linearize(x, shape);
  for (Vec3& normal : result.normals) normal = along(normal);
  for (Vec3& normal : result.partner_normals) normal = along(normal);
  return result;
}

}  // namespace deform
