// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <vector>

#include "core/base/types.h"
#include "core/numerics/lattice/lattice.h"

namespace deform {

/// The lattice of control points of free-form deformation (thesis 3.2).
struct LatticeOptions {
  /// Where it is, model units; none: the box of the mesh with automatic_padding on every side.
  std::optional<LatticeFrame> frame = std::nullopt;
  static constexpr double automatic_padding = 0.02;  ///< of D
  /// Control points along each axis: 4..1000, for bernstein 2..16, at most 100,000 in all; all 0: about cubic cells,
  /// automatic_cells of them along the longest axis, for bernstein degree automatic_degree there.
  std::array<std::size_t, 3> points{};
  static constexpr double automatic_cells = 8;       ///< along the longest axis
  static constexpr double automatic_degree = 6;      ///< of bernstein
  LatticeBasis basis = LatticeBasis::uniform_cubic;  ///< the functions of the control points
  /// Where the control points are before anything is deformed (see MovedLattice), in the order of their numbers, model units;
  /// empty: at rest.
  std::vector<Vec3> control_points{};
};

/// The lattice of a mesh with this box, model units; what is automatic is chosen here. Throws Error(invalid_argument): a box
/// without extent, and what Lattice throws.
Lattice lattice_around(const LatticeOptions& options, const Box& box);

}  // namespace deform
