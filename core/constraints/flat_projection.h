// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "core/base/types.h"
#include "core/constraints/projection.h"

namespace deform {

/// A constraint on points that move along a plane only, as those of a two-dimensional case do: the projection of another
/// constraint without what leads out of the plane. With N = I - n n^T that is the gradient of the other constraint's energy among
/// such motions,
///   N (x - P(x)),
/// so results of project() are the squares of the other one. Points x are expected to have their height over the plane at rest,
/// and projected ones have it. Immutable; any thread.
class FlatProjection : public Projection {
 public:
  /// `normal` has length 1; `rest` are the points at rest, in the units of the projections.
  FlatProjection(std::shared_ptr<const Projection> of, const Vec3& normal, std::span<const Vec3> rest);

  std::string_view kind() const override { return of_->kind(); }
  std::size_t point_count() const override { return of_->point_count(); }
  bool moves_with_its_points() const override { return of_->moves_with_its_points(); }
  bool has_bounds() const override { return of_->has_bounds(); }
  double project(std::span<const Vec3> x, std::span<Vec3> out, ShapeParameters& shape) const override;
  void derivative(std::span<const Vec3> x, const ShapeParameters& shape, std::span<const Vec3> dx,
                  std::span<Vec3> out) const override;
  /// That of the other constraint, whose shape is fitted anew: its distances from x, not their parts along the plane.
  Misfit misfit(std::span<const Vec3> x, std::span<const Vec3> y) const override;
  Linearization linearize(std::span<const Vec3> x, const ShapeParameters& shape) const override;

 private:
  Vec3 along(const Vec3& v) const;

  const std::shared_ptr<const Projection> of_;
  const Vec3 normal_;
  std::vector<double> heights_;
};

}  // namespace deform
