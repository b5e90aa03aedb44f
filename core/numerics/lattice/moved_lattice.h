// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/lattice/lattice.h"

namespace deform {

/// A lattice whose control points have been moved before anything is deformed, so that it follows the shape of a model; the local
/// coordinates of points then take a Newton iteration (thesis 3.2). Immutable; any thread.
class MovedLattice {
 public:
  /// control_points: one per control point of `lattice`. Throws Error(invalid_argument): the wrong number, one that is not
  /// finite.
  MovedLattice(const Lattice& lattice, std::vector<Vec3> control_points);
  ~MovedLattice();

  /// The memory of the samples, in bytes.
  std::size_t bytes() const;
  /// x(u) for u in [0, 1]^3.
  Vec3 place(const Vec3& u) const { return lattice_.sum(control_points_, u); }
  /// u with x(u) = x to 1e-13 of the diagonal of the control points, by damped Newton iterations inside [0, 1]^3 from the nearest
  /// of a grid of samples, four per span and axis; nothing where none of those around leads there: the point is outside.
  /// Throws Error(invalid_argument): det dx/du <= 0 at u, or other samples near x lead to other coordinates: the lattice folds
  /// over.
  std::optional<Vec3> coordinates(const Vec3& x) const;
  /// The coordinates of many points, in parallel; errors name the point by its position.
  LatticeCoordinates coordinates(std::span<const Vec3> points, const RunContext& context = {}) const;

 private:
  struct Samples;
  std::optional<Vec3> from_start(const Vec3& x, Vec3 u) const;

  const Lattice lattice_;
  const std::vector<Vec3> control_points_;
  double diagonal_ = 0;
  std::unique_ptr<const Samples> samples_;
};

}  // namespace deform
