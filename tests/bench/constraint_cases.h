// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "core/deformers/setup.h"
#include "core/deformers/system.h"
#include "core/mesh/mesh.h"

namespace deform::bench {

/// A deformation of a mesh that, but for its constraints, would take away what they keep.
struct ConstraintCase {
  std::string name;
  std::shared_ptr<const Mesh> mesh;
  Setup setup;  ///< the method is the reader's
  Design design;
};

/// [0, 2] x [0, 1] in quads around a round hole of radius 0.25 in its middle, whose rim are the points 0 .. around - 1.
Mesh plate_with_hole(std::size_t around, std::size_t across);

/// Every kind of constraint on a small surface that satisfies it at rest and is bent, twisted, squeezed or stretched (thesis
/// figure 8.6 for five of them), with `fineness` quads per unit of length. Constrained points are neither fixed nor on handles.
std::vector<ConstraintCase> constraint_cases(std::size_t fineness = 30);

/// A block of prisms, [0, 2] x [0, 1] x [0, 1], with four thin layers on the wall z = 0, the group "wall": its left part is
/// fixed, as is the side across, its right part is lifted. The constraint keeps columns of four cells on the middle of the wall
/// rigid.
ConstraintCase prism_block();

/// A case as somebody wants it solved: all its constraints with one weight, 0 = automatic, and one `exact`.
enum class Exactness { off, on };
Setup with_method(const ConstraintCase& of, const decltype(Setup::method)& method, double weight = 0,
                  Exactness exact = Exactness::off);

/// One design, evaluated at all points.
struct Outcome {
  Points points;
  DesignReport report;
  double seconds = 0;
};
Outcome solved(const System& system, const Design& design);

/// Distances of the points of a constraint from its shape, fitted to where they are now. Model units.
struct Misfit {
  double rms = 0, max = 0;
};
Misfit misfit(const Constraint& constraint, const Mesh& mesh, const Points& points);

/// How much sets of points changed their shape: rms distance from the best rigid motion of each set, over the diagonal of its
/// box at rest.
struct ShapeChange {
  double largest = 0, mean = 0;  ///< over the sets
  double largest_distance = 0;   ///< the rms distance itself, model units
};
ShapeChange shape_change(const std::vector<std::vector<PointId>>& sets, const Points& rest, const Points& points);

}  // namespace deform::bench
