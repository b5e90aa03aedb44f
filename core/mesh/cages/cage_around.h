// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <limits>
#include <vector>

#include "core/base/run_context.h"
#include "core/mesh/cages/mirror_frame.h"
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

  static constexpr std::size_t least_points = 8, most_points = 10000;
  static constexpr double count_tolerance = 0.05;  ///< of points
  static constexpr double least_angle = 15;        ///< degrees, of all triangles
  static constexpr double least_clearance = 0.1;   ///< of the offset
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
};

/// A cage around all points of a mesh (thesis 3.4.1): of hull and wrap the offset surface, remeshed with the offset growing by a
/// quarter until all points are inside and keep least_clearance, no two triangles cross, all angles are least_angle or more and
/// the count is met. Of a half model all this is that of the whole cage around the whole model. The faces of the mesh need not be
/// closed, consistent or manifold; isolated points are enclosed, too. Deterministic.
///
/// Throws Error(invalid_argument): options out of their limits, the errors of MirrorFrame and planes for a box, no point, points
/// that all coincide, a box that cannot have so many points, an offset that is too small for a grid; Error(failed_precondition)
/// with what is still wrong when the offset has grown to half the diagonal of the mesh; Error(cancelled, deadline_exceeded) by
/// the context.
CageAround cage_around(const Mesh& mesh, const CageRequest& request, const RunContext& context = {});

}  // namespace deform
