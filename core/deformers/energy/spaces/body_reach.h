// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/mesh/mesh.h"
#include "core/mesh/segment_crossings.h"
#include "core/mesh/winding_number.h"
#include "core/numerics/sampling/mls_basis.h"
#include "core/numerics/sampling/sampling.h"

namespace deform {

/// Distances between places and samples within the body that the faces of a mesh enclose, for MlsBasis. Supports that reach
/// straight across a slot would tie its sides to each other, as long as the slot is narrower than a support, so that the result
/// would change at once when there are so many samples that it no longer is.
///
/// Samples are linked if they are close and the segment between them does not leave the body. Where the shortest way along links
/// is longer than the straight one by more than what links of this length explain, it counts, less that allowance. Samples that
/// no way joins belong to separate bodies, between which the straight distance counts.
///
/// Immutable; any number of threads.
class BodyReach : public SampleReach {
 public:
  /// `points` are those of the mesh, in the coordinates of the samples; ways up to 1.5 radii are known. Keeps no reference.
  BodyReach(const Mesh& mesh, std::span<const Vec3> points, std::vector<Vec3> samples, const DensePoints& dense, double radius,
            const RunContext& context);

  bool lengthens(const Vec3& x, std::span<const PointTree::Near> near) const override;
  void lengthen(const Vec3& x, std::span<const PointTree::Near> near, std::vector<double>& distances) const override;

  /// The number of samples near which some support is cut.
  std::size_t cut() const { return cut_; }
  /// An upper bound of the memory of the construction, in bytes.
  static std::size_t bytes_for(std::size_t triangles, std::size_t samples);

 private:
  struct Way {
    std::uint32_t to;
    double length;
  };

  void place_anchors(const DensePoints& dense, const RunContext& context);
  Vec3 nearest_seen(const PointTree& inside, const Vec3& sample, std::vector<double>& scratch) const;
  void find_links(const PointTree& tree, const RunContext& context);
  void find_parts();
  void find_ways(const PointTree& tree, double limit, const RunContext& context);
  bool within_body(const Vec3& a, const Vec3& b, std::vector<double>& scratch) const;
  /// What a way counts as, if that is more than the straight distance.
  double counted(double way) const;
  double way(std::uint32_t from, std::uint32_t to) const;

  const std::vector<Vec3> samples_;
  SegmentCrossings crossings_;
  WindingNumber winding_;
  double spacing_ = 0;                             ///< median distance of a sample to the nearest other one
  std::vector<Vec3> anchors_;                      ///< a point in the body for each sample
  std::vector<std::vector<std::uint32_t>> links_;  ///< ascending
  std::vector<char> blocked_;                      ///< whether some sample within a link's length is not linked
  std::vector<std::uint32_t> part_;                ///< of the body that links join
  std::vector<std::vector<Way>> ways_;             ///< by ascending number; only of samples with a support that is cut
  std::size_t cut_ = 0;
};

}  // namespace deform
