// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/surface_mesh/paired_corners.h"

#include <algorithm>
#include <span>
#include <string>

#include "core/base/error.h"

namespace deform {

namespace {

/// One corner, filed under the smaller of the end points of its edge.
struct EdgeSide {
  PointId larger;        ///< the other end point
  std::uint32_t corner;  ///< as in paired_corners()
  bool upwards;          ///< its face runs from the smaller to the larger
};

[[noreturn]] void refuse_mesh(const std::string& what) { throw Error(ErrorCode::invalid_argument, "not a 2-manifold: " + what); }

std::string edge_name(PointId a, PointId b) { return "edge " + std::to_string(a) + "-" + std::to_string(b); }

void check_faces(const Mesh& mesh) {
  if (mesh.face_points.size() >= no_corner - 1) refuse_mesh("too many corners for handles of 32 bits");
  std::vector<std::uint32_t> seen_in(mesh.point_count(), no_corner);
  std::size_t corner = 0;
  for (std::uint32_t face = 0; face < mesh.face_count(); ++face) {
    const std::uint32_t size = mesh.face_sizes[face];
    if (size < 3) refuse_mesh("face " + std::to_string(face) + " has " + std::to_string(size) + " corners");
    for (const std::size_t end = corner + size; corner < end; ++corner) {
      const PointId point = mesh.face_points[corner];
      if (seen_in[point] == face) refuse_mesh("face " + std::to_string(face) + " repeats point " + std::to_string(point));
      seen_in[point] = face;
    }
  }
}

std::uint32_t face_of(const Mesh& mesh, std::uint32_t corner) {
  std::uint64_t end = 0;
  for (std::uint32_t face = 0;; ++face) {
    end += mesh.face_sizes[face];
    if (corner < end) return face;
  }
}

[[noreturn]] void refuse_edge(const Mesh& mesh, PointId smaller, std::span<const EdgeSide> sides) {
  std::string faces;
  for (const EdgeSide& side : sides.first(std::min<std::size_t>(sides.size(), 4))) {
    faces += (faces.empty() ? "" : ", ") + std::to_string(face_of(mesh, side.corner));
  }
  const std::string edge = edge_name(smaller, sides.front().larger);
  if (sides.size() > 2)
    refuse_mesh(edge + " has " + std::to_string(sides.size()) + " faces (" + faces + (sides.size() > 4 ? ", ...)" : ")"));
  refuse_mesh("faces " + faces + " run along " + edge + " in the same direction");
}

/// Pairs what runs along the edges from one point to larger ones.
void pair_sides(const Mesh& mesh, PointId smaller, std::span<EdgeSide> sides, std::vector<std::uint32_t>& pairs) {
  const auto before = [](const EdgeSide& a, const EdgeSide& b) {
    return a.larger != b.larger ? a.larger < b.larger : a.corner < b.corner;
  };
  std::sort(sides.begin(), sides.end(), before);
  for (std::size_t begin = 0, end = 0; begin < sides.size(); begin = end) {
    while (end < sides.size() && sides[end].larger == sides[begin].larger) ++end;
    if (end - begin == 1) continue;
    if (end - begin > 2 || sides[begin].upwards == sides[begin + 1].upwards) {
      refuse_edge(mesh, smaller, sides.subspan(begin, end - begin));
    }
    pairs[sides[begin].corner] = sides[begin + 1].corner;
    pairs[sides[begin + 1].corner] = sides[begin].corner;
  }
}

}  // namespace

std::vector<std::uint32_t> paired_corners(const Mesh& mesh) {
  check_faces(mesh);
  const std::size_t n = mesh.point_count();
  // Visits all edges of all faces as (point, next point, corner).
  const auto for_each_side = [&](const auto& visit) {
    std::uint32_t corner = 0;
    for (const std::uint32_t size : mesh.face_sizes) {
      const std::uint32_t first = corner, last = corner + size - 1;
      for (; corner < last; ++corner) visit(mesh.face_points[corner], mesh.face_points[corner + 1], corner);
      visit(mesh.face_points[last], mesh.face_points[first], last);
      ++corner;
    }
  };
  std::vector<std::uint32_t> ends(n + 1, 0);
  for_each_side([&](PointId a, PointId b, std::uint32_t) { ++ends[std::min(a, b) + 1]; });
  for (std::size_t i = 0; i < n; ++i) ends[i + 1] += ends[i];
  std::vector<EdgeSide> sides(mesh.face_points.size());
  // ends[i] moves from the begin of point i to its end, which is the begin of point i + 1.
  for_each_side([&](PointId a, PointId b, std::uint32_t corner) {
    sides[ends[std::min(a, b)]++] = {std::max(a, b), corner, a < b};
  });

  std::vector<std::uint32_t> pairs(mesh.face_points.size(), no_corner);
  for (PointId point = 0; point < n; ++point) {
    const std::uint32_t begin = point == 0 ? 0 : ends[point - 1];
    pair_sides(mesh, point, std::span(sides).subspan(begin, ends[point] - begin), pairs);
  }
  return pairs;
}

}  // namespace deform
