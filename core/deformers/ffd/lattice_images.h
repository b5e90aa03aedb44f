// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "core/base/types.h"
#include "core/deformers/handles/control_system.h"
#include "core/deformers/handles/symmetry.h"
#include "core/deformers/setup.h"
#include "core/mesh/mesh.h"
#include "core/numerics/lattice/lattice.h"
#include "core/numerics/lattice/lattice_options.h"

namespace deform {

/// The lattice options of a model with symmetry planes: an automatic box becomes that of the model with its images.
LatticeOptions whole_lattice(LatticeOptions options, const Mesh& mesh, const Symmetry& symmetry);

/// Which control points are mirror images of each other: for each its image, or ControlMatches::no_control. `places` are where
/// they are at rest, `reflect` maps a place to its image. The reflection must be one of indices, along one axis, or exchange two
/// axes, such that the functions of the images are the images of the functions wherever both have any:
///  - a lattice that is its own image;
///  - a lattice that ends in the plane, on one side of it: one layer of control points lies in the plane, with
///    LatticeBasis::uniform_cubic the second one, whose neighbours are images of each other;
///  - with LatticeBasis::uniform_cubic any for which the planes of knots are images of each other, as these functions are the
///  same
///    up to a shift.
/// Empty for all others. Distances up to `tolerance` do not count.
std::vector<std::uint32_t> lattice_images(const Lattice& lattice, LatticeBasis basis, const std::vector<Vec3>& places,
                                          const std::function<Vec3(const Vec3&)>& reflect, double tolerance);

/// The control points of a lattice and their functions, for handles that move them. Throws the errors of control_lattice(), and
/// Error(invalid_argument) if an automatic lattice is not symmetric, that is if a plane is not perpendicular to an axis.
ControlModel lattice_controls(const LatticeOptions& options, const Mesh& mesh, const Symmetry& symmetry,
                              const RunContext& context);

}  // namespace deform
