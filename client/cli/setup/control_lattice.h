// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "client/setup/mirror_planes.h"
#include "core/mesh/mesh.h"
#include "core/mesh/region.h"
#include "core/numerics/lattice/lattice.h"
#include "deform/v1/setup.pb.h"

namespace deform::cli {

/// Whether handles and fixed regions of the setup select control points.
bool selects_controls(const v1::Setup& setup);

/// Where the control points of a setup that selects_controls() are at rest: those of its lattice, or the vertices of its cage.
/// Throws what control_lattice() throws.
std::vector<Vec3> control_places(const v1::Setup& setup, const Mesh& mesh);

/// The control points of a region of a setup that selects_controls(). Throws what select_controls() throws.
std::vector<PointId> control_points_of(const v1::Region& region, const v1::Setup& setup, const Mesh& mesh,
                                       const std::string& what);

/// The lattice of a setup with method.ffd around a mesh, as the server makes it; with symmetry planes around the mesh and its
/// images.
struct ControlLattice {
  Lattice lattice;
  std::vector<Vec3> places;  ///< of the control points before a design moves them
  ControlSet controls() const;
};
/// Throws Error(invalid_argument) naming the field: another method, a lattice that cannot be made, control points of the wrong
/// number, an automatic box beside a plane that client::mirror_planes() does not find.
ControlLattice control_lattice(const v1::Setup& setup, const Mesh& mesh);

/// The control points of a region of a setup that selects_controls(). Throws what select_controls() throws.
std::vector<PointId> control_points_of(const v1::Region& region, const ControlLattice& lattice, const std::string& what);

/// Where the control points are in a design, of a setup that selects_controls(). places: where they are at rest; values: one per
/// variable. Throws Error(invalid_argument): a value out of its bounds, regions as above.
std::vector<Vec3> moved_controls(const v1::Setup& setup, const ControlSet& controls, const std::vector<Vec3>& places,
                                 const std::vector<double>& values);
std::vector<Vec3> moved_controls(const v1::Setup& setup, const ControlLattice& lattice, const std::vector<double>& values);
/// Moves the control points that are mirror images of others as these, if they do not move themselves.
void move_images(const std::vector<std::optional<client::MirrorPlane>>& planes, const std::vector<Vec3>& at_rest,
                 std::vector<Vec3>& moved);

/// A label per control point, as region_labels(): one in several regions has that of the first handle.
std::vector<std::uint32_t> control_labels(const v1::Setup& setup, const ControlSet& controls);

/// The vertices of the cage of a setup with method.cage that was read from a file.
ControlSet cage_controls(const v1::Setup& setup);

}  // namespace deform::cli
