// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/mesh/mesh.h"
#include "core/quality/extreme.h"
#include "core/quality/mean_curvature.h"

namespace deform {

/// Measures how smoothly the regions of a deformation meet (thesis 4.4). A border edge is one whose end points have
/// different labels.
///
/// Jump of normals: the angle between the normals of both sides. The normal of a side is the sum of the vector areas of the faces
/// at the end point whose corners all have its label, or of all faces at the point if there are none (a region one point wide).
/// So a fold is measured in full, whether it is in the last row of one region, in the first of the other or between them. Jump of
/// mean curvature: the difference of the mean curvatures of the end points, if both have one.
struct RegionJumps {
  std::size_t edges = 0;            ///< border edges
  Extreme largest_normal_jump;      ///< degrees; id: the end point with the smaller id
  double rms_normal_jump = 0;       ///< degrees, root mean square over the border edges
  std::size_t curvature_edges = 0;  ///< border edges whose end points both have a curvature
  Extreme largest_curvature_jump;   ///< 1 / length; id as above
  double rms_curvature_jump = 0;    ///< 1 / length, root mean square over curvature_edges
  /// The jumps of all border edges, sorted by the smaller, then the larger point id. A curvature jump is NaN if an end point has
  /// no curvature.
  std::vector<PointId> points;          ///< smaller point id of each border edge
  std::vector<double> normal_jumps;     ///< degrees
  std::vector<double> curvature_jumps;  ///< 1 / length
};

/// The largest increase of the jumps by a deformation over the border edges, so that sharp edges of the model itself do not hide
/// it; 0 if none increased.
struct JumpGrowth {
  Extreme normal;     ///< degrees; id: the end point with the smaller id
  Extreme curvature;  ///< 1 / length; id as above
};
/// Compares the jumps of a mesh before and after a deformation, with the same labels. Throws Error(invalid_argument) if the
/// numbers of edges differ.
JumpGrowth jump_growth(const RegionJumps& after, const RegionJumps& before);

/// `labels` has one entry for each point, equal within a region; `curvature` is that of the mesh. Parallel; bitwise
/// independent of the number of threads. Throws Error(invalid_argument) if the number of labels is not that of points,
/// cancelled, deadline_exceeded.
RegionJumps region_jumps(const Mesh& mesh, std::span<const std::uint32_t> labels, const MeanCurvature& curvature,
                         const RunContext& context = {});

}  // namespace deform
