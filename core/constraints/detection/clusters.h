// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <span>
#include <vector>

#include "core/constraints/detection/surface.h"

namespace deform::detection {

/// The faces of a fine mesh in small clusters, over which regions find their shapes before they look at all faces: connected, not
/// across sharp edges, bent by less than a quarter of the maximum angle (and what noise explains), of an area up to `largest`
/// unless it is one face. Read-only once built.
struct Clusters {
  Clusters(const Surface& fine, double largest);

  std::size_t count() const { return begin.size() - 1; }
  std::span<const FaceId> faces(std::size_t cluster) const {
    return {order.data() + begin[cluster], begin[cluster + 1] - begin[cluster]};
  }
  /// The labels of the faces that stand for the clusters.
  std::vector<std::uint32_t> labels(std::span<const std::uint32_t> of_faces) const;

  std::vector<FaceId> order;       ///< all faces, cluster by cluster; the first of each stands for it
  std::vector<std::size_t> begin;  ///< first of each cluster in order; one more entry at the end
  std::vector<FaceId> cluster_of;  ///< per face
  /// One face for each cluster: the one that stands for it, with the area of all. Its neighbours are those that it passes to, by
  /// the smallest angle and without an edge.
  Surface surface;

 private:
  void gather(const Surface& fine, double largest);
  void connect(const Surface& fine);
};

}  // namespace deform::detection
