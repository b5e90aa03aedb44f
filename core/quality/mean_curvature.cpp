// SPDX-License-Identifier: Apache-2.0
#include "core/quality/mean_curvature.h"

#include <algorithm>
#include <limits>

#include "core/base/parallel.h"
#include "core/mesh/edge_uses.h"
#include "core/quality/polygon.h"

namespace deform {

namespace {

using namespace quality;

constexpr std::size_t curvatures_per_range = 4096;
constexpr double degenerate = 1e-10;  // twice the area over the longest edge squared

/// The contribution of triangles to one of their corners: the gradient of their area, and the share of the corner in it.
struct Share {
  Vec3 gradient{};
  double area = 0;

  void add(const Share& other, double weight = 1) {
    gradient = gradient + weight * other.gradient;
    area += weight * other.area;
  }
};

/// The share of corner x of the triangle x, y, z.
Share corner_share(const Vec3& x, const Vec3& y, const Vec3& z) {
  const Vec3 xy = y - x, xz = z - x, yz = z - y;
  const double twice_area = length(cross(xy, xz));
  const double longest = std::max({dot(xy, xy), dot(xz, xz), dot(yz, yz)});
  if (!(twice_area > degenerate * longest)) return {};
  const double cosine_x = dot(xy, xz), cosine_y = -dot(xy, yz), cosine_z = dot(xz, yz);  // times lengths
  const double cot_y = cosine_y / twice_area, cot_z = cosine_z / twice_area;
  Share share;
  share.gradient = -0.5 * (cot_z * xy + cot_y * xz);
  if (cosine_x < 0) {
    share.area = twice_area / 4;
  } else if (cosine_y < 0 || cosine_z < 0) {
    share.area = twice_area / 8;
  } else {
    share.area = (dot(xy, xy) * cot_z + dot(xz, xz) * cot_y) / 8;
  }
  return share;
}

class Curvatures {
 public:
  Curvatures(const Mesh& mesh, const Adjacency& adjacency, const RunContext& context)
      : mesh_(mesh), adjacency_(adjacency), context_(context) {}

  MeanCurvature run() {
    measure_middles();
    const std::size_t n = mesh_.point_count();
    MeanCurvature result{std::vector<double>(n), std::vector<double>(n)};
    parallel_for(context_, n, curvatures_per_range, [&](std::size_t begin, std::size_t end) {
      std::vector<EdgeUse> edges;
      for (std::size_t i = begin; i < end; ++i) {
        const auto point = static_cast<PointId>(i);
        const Share share = point_share(point);
        edge_uses(adjacency_, point, edges);
        const bool inside = std::all_of(edges.begin(), edges.end(), [](const EdgeUse& e) { return e.faces() == 2; });
        result.area[i] = share.area;
        result.value[i] =
            inside && share.area > 0 ? length(share.gradient) / (2 * share.area) : std::numeric_limits<double>::quiet_NaN();
      }
    });
    return result;
  }

 private:
  /// Middle points of polygons: where they are, and their shares, which go to the corners.
  void measure_middles() {
    const std::size_t faces = mesh_.face_count();
    middle_.resize(faces);
    middle_share_.resize(faces);
    parallel_for(context_, faces, curvatures_per_range, [&](std::size_t begin, std::size_t end) {
      for (std::size_t f = begin; f < end; ++f) {
        const auto corners = adjacency_.points_of(static_cast<FaceId>(f));
        if (corners.size() <= 3) continue;
        middle_[f] = mean_of(mesh_.points, corners);
        for (std::size_t c = 0; c < corners.size(); ++c) {
          const PointId next = corners[c + 1 == corners.size() ? 0 : c + 1];
          middle_share_[f].add(corner_share(middle_[f], mesh_.points[corners[c]], mesh_.points[next]));
        }
      }
    });
  }

  Share point_share(PointId point) const {
    Share share;
    for (const FaceId f : adjacency_.faces_of(point)) {
      const auto corners = adjacency_.points_of(f);
      const std::size_t size = corners.size();
      if (size < 3) continue;
      for (std::size_t c = 0; c < size; ++c) {
        if (corners[c] != point) continue;
        const Vec3& at = mesh_.points[point];
        const Vec3& next = mesh_.points[corners[c + 1 == size ? 0 : c + 1]];
        const Vec3& previous = mesh_.points[corners[c == 0 ? size - 1 : c - 1]];
        if (size == 3) {
          share.add(corner_share(at, next, previous));
          continue;
        }
        share.add(corner_share(at, next, middle_[f]));
        share.add(corner_share(at, middle_[f], previous));
        share.add(middle_share_[f], 1 / static_cast<double>(size));
      }
    }
    return share;
  }

  const Mesh& mesh_;
  const Adjacency& adjacency_;
  const RunContext& context_;
  std::vector<Vec3> middle_;
  std::vector<Share> middle_share_;
};

}  // namespace

MeanCurvature mean_curvature(const Mesh& mesh, const Adjacency& adjacency, const RunContext& context) {
  return Curvatures(mesh, adjacency, context).run();
}

}  // namespace deform
