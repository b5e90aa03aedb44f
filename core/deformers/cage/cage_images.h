// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/deformers/cage/cage_model.h"
#include "core/deformers/handles/control_system.h"
#include "core/deformers/handles/symmetry.h"
#include "core/deformers/setup.h"
#include "core/mesh/cages/mirror_frame.h"
#include "core/mesh/mesh.h"
#include "core/numerics/cage/cage.h"

namespace deform {

/// How a cage stands to symmetry planes or a sector. About each plane it is
///  - its own mirror image, vertex by vertex and triangle by triangle; or
///  - on one side of it, where it ends: only vertices in the plane have an image, themselves.
/// That of a sector is
///  - around the whole wheel, the same in every sector; or
///  - it ends in the periodic boundaries: only vertices on one of them have images, on the other, and those on the axis.
struct CagePlanes {
  ControlMatches matches;  ///< of its vertices
  /// A plane in which the cage ends.
  struct End {
    std::size_t plane;
    double side;  ///< of the cage: 1, that of the mesh, or -1
  };
  std::vector<End> ends;
  bool in_sector = false;  ///< whether it ends in periodic boundaries
};
/// Throws Error(invalid_argument) for all other cages, naming the plane and a vertex or triangle.
CagePlanes cage_planes(const Cage& cage, const Symmetry& symmetry);

/// The vertices of a cage and their mean value coordinates in a model with symmetry planes or in the sector of a wheel, see
/// CagePlanes. Where a cage is its own mirror image, so are the coordinates, and what moves a vertex moves its image. Where it
/// ends in a plane, its mirror image stands behind the plane; vertices in the plane stay there, and so do points in it, which
/// only those vertices move. Coordinates are not stored, as in cage_model(). Throws the errors of cage_planes() and cage_of(),
/// and for cages that end in periodic boundaries, whose coordinates would reach beyond.
struct CageControls {
  ControlModel model;
  std::shared_ptr<const Mesh> places;  ///< the mesh, or its points where the cage is, behind a plane
};
CageControls cage_controls(const CageOptions& options, const std::shared_ptr<const Mesh>& mesh, const Symmetry& symmetry);

/// Throws Error(invalid_argument) if points of the mesh lie in a plane in which the cage ends, but outside of its face there,
/// with their number and the first one: other vertices would move them out of the plane. Takes the time of the coordinates of the
/// points in such planes.
void check_cut(const ControlModel& model, const Mesh& mesh, const Symmetry& symmetry, const RunContext& context);

/// In which planes a cage is its own mirror image, vertex by vertex and triangle by triangle to 1e-9 of its diagonal: those of
/// mirror_candidates() and surface_mirrors().
std::vector<CagePlane> own_planes(const Cage& cage);

/// The same in no time, before anything is prepared: whether they are near triangles of the cage in the plane. `places` is that
/// of CageControls.
void check_faces(const Cage& cage, const ControlMatches& matches, const Mesh& places, const Symmetry& symmetry);

/// For each vertex of a cage its image among them, in a plane or another sector; `no_image` has the reason if there is none:
/// "vertex 5 has no image". `reflect` maps a place to its image. Distances up to `tolerance` do not count.
struct CageImages {
  std::vector<std::uint32_t> image;
  std::string no_image;
};
CageImages cage_images(const Cage& cage, const std::function<Vec3(const Vec3&)>& reflect, double tolerance);

}  // namespace deform
