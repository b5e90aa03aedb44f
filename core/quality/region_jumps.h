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

/// How smoothly the regions of a deformation meet (thesis 4.4). A border edge is one whose end points carry different labels.
///
/// Jump of normals: the angle between the normals of both sides. The normal of a side is the sum of the vector areas of those
/// faces at the end point of which all corners carry its label, or of all faces at the point when there are none (a region one
/// point wide). A fold is seen in full, whether it is in the last row of one region, the first of the other or between them. Jump
/// of mean curvature: the difference of the mean curvatures of the end points, where both have one.
struct RegionJumps {
  std::size_t edges = 0;            ///< border edges
  Extreme largest_normal_jump;      ///< degrees; id: the end point of the lower number
  double rms_normal_jump = 0;       ///< degrees, root of the mean square over the border edges
  std::size_t curvature_edges = 0;  ///< border edges whose end points both have a curvature
  Extreme largest_curvature_jump;   ///< 1 / length; id as above
  double rms_curvature_jump = 0;
  /// The jumps one by one: of all border edges, by their points of lower, then of higher number. A curvature jump that is not a
  /// number: an end point has no curvature.
  std::vector<PointId> points;  ///< of lower number
  std::vector<double> normal_jumps, curvature_jumps;
};

/// What a deformation did to the jumps: the largest growth over the border edges, which sharp edges of the model itself do not
/// hide. 0 where none grew.
struct JumpGrowth {
  Extreme normal, curvature;  ///< degrees, 1 / length; id: the end point of the lower number
};
/// Of the same mesh with the same labels and other points. Throws Error(invalid_argument) when the numbers of edges differ.
JumpGrowth jump_growth(const RegionJumps& after, const RegionJumps& before);

/// labels: one per point, equal within a region. `curvature` is that of the mesh. Parallel; the same bits for any
/// number of threads. Throws Error(invalid_argument) when there are not as many labels as points, cancelled, deadline_exceeded.
RegionJumps region_jumps(const Mesh& mesh, std::span<const std::uint32_t> labels, const MeanCurvature& curvature,
                         const RunContext& context = {});

}  // namespace deform
