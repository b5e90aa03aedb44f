// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "client/cli/setup/control_lattice.h"
#include "core/mesh/mesh.h"
#include "core/numerics/lattice/refinement.h"
#include "deform/v1/setup.pb.h"

namespace deform::cli {

/// What a lattice with more control points makes of a setup.
struct RefinedSetup {
  ControlLattice lattice;                 ///< with the control points where they are before a design moves them
  std::array<std::size_t, 3> before{};    ///< control points along each axis
  std::optional<std::vector<Vec3>> mesh;  ///< points of the mesh of a design; none: no design was asked for
  std::size_t outside = 0;                ///< points of the mesh outside of the lattice, which stay where they are
  std::string text;                       ///< the setup file
};

/// How deform lattice refine changes a setup file.
struct Refinement {
  std::filesystem::path setup;  ///< the setup file
  std::array<bool, 3> axes{};   ///< which axes get more control points
  std::vector<double> values;   ///< one per variable: the design whose shape is the new one at rest; none: that at rest stays
  std::string control_points, geometry;  ///< names in the new setup: of the file of control points where they are not at rest,
                                         ///< and with `values` of that of the mesh
};

/// Replaces the lattice of a setup with method.ffd by a finer one that makes the same shapes (see LatticeRefinement), and in
/// handles and fixed regions control points by those of the finer lattice (see refined_selection()). Ranges stay ranges, other
/// regions become lists of ids. Files that the setup names are not copied. mesh: its geometry.
///
/// Throws Error(invalid_argument) naming field and limit: another method, more control points than allowed, values with another
/// control than CONTROLS, regions and values that cannot be; Error(failed_precondition) for YAML that cannot be written
/// again without a change of what it says.
RefinedSetup refined_setup(const Refinement& refinement, const Mesh& mesh);

}  // namespace deform::cli
