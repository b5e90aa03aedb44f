// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/mesh/cages/mirror_frame.h"
#include "core/mesh/remeshing/closest_point.h"

namespace deform {

/// Planes in which a body may be its own mirror image, with unit normals: across the coordinate axes, through the origin, the
/// middle of its box and its centroid, and across its principal axes, through the centroid; where two principal moments are
/// nearly the same, across some axes in between, too. Centroid and moments are those of the area or, where there is none, of the
/// corners.
std::vector<CagePlane> mirror_candidates(std::span<const TriangleCorners> triangles);

/// In which planes a surface is its own mirror image.
struct SurfaceMirrors {
  /// Orthogonal to each other, at most 3, with unit normals, those across coordinate axes first. A surface that has more is given
  /// the plane that fits best, then the best of those orthogonal to it, and so on. Of planes that fit as well, with deviations of
  /// at most 1.5 times the least, it is one across a coordinate axis, or else that from which the surface reaches least far.
  std::vector<CagePlane> planes;
  /// The largest distance of the surface from its mirror image in any of them, model units.
  double deviation = 0;
  /// A plane that is none because the image is too far away.
  struct Near {
    CagePlane plane;
    double deviation = 0;  ///< model units
    Vec3 at{};             ///< a place on the surface whose image is so far away
  };
  /// If there are no planes, the best one that misses the tolerance by a factor of at most `nearly`.
  std::optional<Near> near;

  static constexpr double nearly = 20;
};

/// Looks for planes in which the corners of triangles have images at most `tolerance` (model units, over 0) from the triangles.
/// What counts is the surface: vertices need not be images of each other, as those of surfaces that were meshed without regard to
/// their symmetry are not. A reflection takes itself back, so the surface is nowhere farther from its image either. Triangles
/// must be small as against the features of the surface, as only corners are looked at. Planes across coordinate and principal
/// axes that nearly fit are moved to where they fit best: by Gauss-Newton steps of the distances between images and surface
/// (iterated closest points with distances from planes: Chen and Medioni 1992). Mirror planes are across eigenvectors of the
/// second moments, so where two of the three moments are the same, or all, planes across directions between these axes, in steps
/// of a degree, or over a ball, in steps of 4.5 degrees, are tried likewise. Deterministic.
///
/// Throws Error(cancelled, deadline_exceeded) by the context.
SurfaceMirrors surface_mirrors(std::vector<TriangleCorners> triangles, double tolerance, const RunContext& context = {});

}  // namespace deform
