// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "core/base/problems.h"
#include "core/base/types.h"
#include "core/deformers/handles/flat_case.h"
#include "core/deformers/setup.h"
#include "core/mesh/mesh.h"

namespace deform {

/// Where the rate of a map of positions takes a point out of a symmetry plane on which it lies.
struct PlaneExit {
  std::size_t plane = 0;
  double rate = 0;  ///< along its normal, model units per unit of the variable
};
/// The first of the planes `on` (mask) that the point leaves by more than the rounding of the terms of the rate; nothing if it
/// stays in all. `diagonal` is that of the mesh.
std::optional<PlaneExit> plane_exit(const Symmetry& symmetry, unsigned on, const Affine& rate, const Vec3& x, double diagonal);

/// Whether variables, each alone, let the points of their handles slide in the symmetry planes on which they lie: at rest, and at
/// both bounds or 1 where there is none. Adds a problem "variables[k]" for each that does not, naming the handle, its first such
/// point and the plane: designs that move it would be refused. `places` are those that the regions of handles select: points of
/// the mesh, or control points. `symmetry` is that of the mesh, `point_word` what the places are called.
struct SlidingPlaces {
  const Symmetry& symmetry;
  const std::vector<Vec3>& places;
  const std::vector<std::vector<PointId>>& handles;  ///< of each handle of the setup
  double diagonal = 1;                               ///< of the mesh
  const char* point_word = "point";
};
void check_variables_slide(const Setup& setup, const SlidingPlaces& at, Problems& problems);
/// The same for the planes of a two-dimensional case.
void check_variables_flat(const FlatCase& flat, const Setup& setup, const SlidingPlaces& at, Problems& problems);
/// Throws Error(invalid_argument) if a handle or the fixed regions hold only one of two opposite points of a two-dimensional
/// case, naming both.
void check_one_sided(const FlatCase& flat, const Setup& setup, const SelectedRegions& regions);

}  // namespace deform
