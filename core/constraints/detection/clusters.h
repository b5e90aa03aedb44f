// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <span>
#include <vector>

#include "core/constraints/detection/surface.h"

namespace deform::detection {

/// Partitions the faces of a fine mesh into small clusters, on which regions find their shapes before all faces are used. A
/// cluster is connected without crossing sharp edges, bends by less than a quarter of the maximum angle (plus the effect of
/// noise), and has an area of at most `largest` unless it is a single face. Immutable after construction.
struct Clusters {
  Clusters(const Surface& fine, double largest);

  std::size_t count() const { return begin.size() - 1; }
  std::span<const FaceId> faces(std::size_t cluster) const {
    return {order.data() + begin[cluster], begin[cluster + 1] - begin[cluster]};
  }
  /// The labels of the clusters: those of their representative faces.
  std::vector<std::uint32_t> labels(std::span<const std::uint32_t> of_faces) const;

  std::vector<FaceId> order;       ///< all faces, cluster by cluster; the first one represents its cluster
  std::vector<std::size_t> begin;  ///< count() + 1 offsets of the clusters in `order`
  std::vector<FaceId> cluster_of;  ///< index of the cluster of each face
  /// A surface with one face for each cluster: its representative, with the area of the cluster. Neighbours are the adjacent
  /// clusters that are not behind a sharp edge, with the smallest angle; their edges are not set.
  Surface surface;

 private:
  void gather(const Surface& fine, double largest);
  void connect(const Surface& fine);
};

}  // namespace deform::detection
