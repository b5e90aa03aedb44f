// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/mesh/mesh.h"
#include "core/quality/extreme.h"
#include "core/quality/mean_curvature.h"

namespace deform {

/// Quality measures of the faces and points of a surface mesh. A polygon with more than three corners is a fan of triangles
/// around the mean of its corners; its area and normal do not depend on the triangulation.
struct SurfaceQuality {
  static constexpr std::size_t bins = 20;        ///< of the histogram of face quality
  static constexpr std::size_t angle_bins = 18;  ///< of the histogram of angles

  std::size_t points = 0;  ///< number of points
  std::size_t faces = 0;   ///< number of faces
  /// The quality of a face is 2 r / R, twice the radius of the inscribed circle over that of the circumscribed one: 1 for the
  /// equilateral triangle, 0 without area. For a polygon it is that of the worst triangle of its fan, divided by the value for
  /// the regular polygon: 1 for squares.
  Extreme least_face_quality;
  double average_face_quality = 0;  ///< over the faces
  /// At a corner of a face, degrees 0..180 (a reflex corner counts as 360 less its angle).
  Extreme least_angle;
  Extreme largest_angle;  ///< the same
  Extreme least_area;     ///< of a face
  Extreme largest_area;   ///< of a face
  double total_area = 0;  ///< of all faces
  /// Faces with fewer than three corners, a repeated corner, or an area below least_area(), as counted by `deform inspect`.
  std::size_t degenerate_faces = 0;
  Extreme largest_mean_curvature;             ///< point
  double average_mean_curvature = 0;          ///< weighted by the areas of the points
  std::size_t curvature_points = 0;           ///< points with a mean curvature; the others are on boundaries or non-manifold
  std::array<std::size_t, bins> histogram{};  ///< face quality from 0 to 1
  std::array<std::size_t, angle_bins> angle_histogram{};  ///< corner angles from 0 to 180 degrees
  std::vector<std::size_t> worst;                         ///< ids of the faces of least quality, worst first, at most 100
  std::vector<std::size_t> degenerate;                    ///< the first degenerate faces, at most 100
  std::vector<double> face_quality;                       ///< f
  MeanCurvature mean_curvature;                           ///< n
};

/// Measures the faces and points in parallel; bitwise independent of the number of threads. Throws Error(invalid_argument) for a
/// mesh without faces, cancelled, deadline_exceeded.
SurfaceQuality surface_quality(const Mesh& mesh, const RunContext& context = {});

}  // namespace deform
