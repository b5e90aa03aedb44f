// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/deformers/system.h"

namespace deform {

/// One design as a map of space: where points go that need not be points of the mesh. Made by System::bind_in_space(). Immutable;
/// any number of threads may call it at once. Keeps its system alive.
///
/// At the coordinates of a point of the mesh it gives what Evaluation::evaluate() gives for that point on the direct path, bit
/// for bit, or within the tolerance of the iterative solver, whose fast sums depend on the points that are summed together.
/// Handle and fixed points that are met exactly, and points of exact constraints, are recognized by their coordinates, which have
/// to be equal to the last bit.
class SpaceMap {
 public:
  virtual ~SpaceMap() = default;

  /// What was found about the points of one call.
  struct Found {
    std::size_t still = 0;  ///< points where the deformation is not defined and that stay at rest: outside of a lattice
    double sums_error = 0;  ///< estimated error of sums that are not direct, at these points, model units
  };

  /// The report on the design. report().error is estimated at points of the mesh and says nothing about points far from them.
  virtual const DesignReport& report() const = 0;
  /// Writes the deformed positions of `points` (model units, finite) to `out`, which has the same size. `first` is the number of
  /// the first point, for messages. Throws Error(invalid_argument) naming points[i] where the deformation does not exist: outside
  /// of a cage with Green coordinates; cancelled, deadline_exceeded.
  virtual Found evaluate(std::span<const Vec3> points, std::uint64_t first, std::span<Vec3> out,
                         const RunContext& context) const = 0;
};

}  // namespace deform
