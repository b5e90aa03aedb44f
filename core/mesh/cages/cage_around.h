// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <limits>
#include <optional>
#include <vector>

#include "core/base/run_context.h"
#include "core/mesh/cages/mirror_frame.h"
#include "core/mesh/cages/mirror_search.h"
#include "core/mesh/mesh.h"

namespace deform {

enum class CageKind {
  box,   ///< a box along the axes, its faces divided into rectangles
  hull,  ///< around the convex hull
  wrap,  ///< follows the surface, concavities and handles too, as far as they are wider than twice the offset
};

/// How cage_around() makes a cage.
struct CageRequest {
  CageKind kind = CageKind::wrap;
  std::size_t points = 400;  ///< vertices of the cage, met within 5 %; least_points to most_points
  /// Distance of the cage from the mesh to begin with, model units; 0: automatic, of a box 0.05 D, else about a third of the
  /// length of its edges.
  double offset = 0;
  /// Where a box ends at the latest, model units: that of a half model ends in its symmetry plane. Not for hull and wrap.
  Vec3 lowest{-std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity(),
              -std::numeric_limits<double>::infinity()};
  Vec3 highest{std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity(),
               std::numeric_limits<double>::infinity()};
  /// Symmetry planes of a half model, at most 3 that are orthogonal to each other. Hull and wrap are then around the mesh and its
  /// mirror images, and their own mirror images in each plane, vertex by vertex and triangle by triangle, to rounding. Vertices
  /// on the side of the mesh come first, those in the planes among them. Not for boxes.
  std::vector<CagePlane> planes{};
  /// Without `planes`: a surface that is this close to its own mirror image, as a fraction of D, gets a hull or wrap that is its
  /// own mirror image in each such plane, as with `planes`, or a box that is in those across axes; 0: none is looked for. At most
  /// most_symmetry_tolerance.
  double symmetry_tolerance = usual_symmetry_tolerance;

  static constexpr std::size_t least_points = 8, most_points = 10000;
  static constexpr double count_tolerance = 0.05;  ///< of points
  static constexpr double least_angle = 15;        ///< degrees, of all triangles
  static constexpr double least_clearance = 0.1;   ///< of the offset
  /// Surfaces that are meshed without regard to their symmetry are off by up to 7e-4 D; what is off by 1e-3 D is not symmetric.
  /// It is a fifth of the least offset.
  static constexpr double usual_symmetry_tolerance = 8e-4;
  static constexpr double most_symmetry_tolerance = 0.1;
};

/// A cage and what there is to say about it.
struct CageAround {
  Mesh mesh;                   ///< closed 2-manifold of triangles that face outwards, without groups
  double offset = 0;           ///< with which it was made, model units
  double clearance = 0;        ///< least distance of a point of the model from the cage, model units
  double least_angle = 0;      ///< degrees
  std::size_t components = 0;  ///< that are not connected
  std::size_t genus = 0;       ///< of all components together
  int attempts = 0;            ///< with growing offsets, the last of which made it
  /// In which it is its own mirror image: those that were asked for, or found.
  std::vector<CagePlane> planes{};
  /// Planes of the model that were found, but in which no cage of so few points was its own mirror image, or no box along the
  /// axes can be.
  std::vector<CagePlane> without{};
  double asymmetry = 0;  ///< with planes that were found: the largest distance of the model from its image, model units
  /// The plane that was not taken because the model is farther from its image, if there is one that comes near; of boxes, across
  /// an axis.
  std::optional<SurfaceMirrors::Near> nearly_symmetric{};
};

/// A cage around all points of a mesh (thesis 3.4.1): of hull and wrap the offset surface, remeshed with the offset growing by a
/// quarter until all points are inside and keep least_clearance, no two triangles cross, all angles are least_angle or more and
/// the count is met. Of a half model all this is that of the whole cage around the whole model. A model that is its own mirror
/// image within symmetry_tolerance gets a cage around itself and its images, as if they were half models; if none is found with
/// these planes, one with fewer or without. A box that is its own mirror image has an even number of rectangles along the axis
/// across the plane. The faces of the mesh need not be closed, consistent or manifold; isolated points are
/// enclosed, too. Deterministic.
///
/// Throws Error(invalid_argument): options out of their limits, the errors of MirrorFrame and planes for a box, no point, points
/// that all coincide, a box that cannot have so many points, an offset that is too small for a grid; Error(failed_precondition)
/// with what is still wrong when the offset has grown to half the diagonal of the mesh; Error(cancelled, deadline_exceeded) by
/// the context.
CageAround cage_around(const Mesh& mesh, const CageRequest& request, const RunContext& context = {});

}  // namespace deform
