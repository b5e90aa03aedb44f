// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/cages/convex_hull.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/vectors.h"

namespace deform {

namespace {

// Differences have at most 20 bits and a sign, so that the determinants below fit into 64 bits.
constexpr std::int64_t steps = (std::int64_t{1} << 20) - 2;
constexpr std::uint32_t no_face = std::numeric_limits<std::uint32_t>::max();

using Node = std::array<std::int64_t, 3>;

Node operator-(const Node& a, const Node& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
Node cross(const Node& a, const Node& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
std::int64_t dot(const Node& a, const Node& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/// Nodes ascending, each once.
class Quickhull {
 public:
  explicit Quickhull(const std::vector<Node>& nodes) : nodes_(nodes) {}

  /// Triangles of the hull, or nothing where all nodes lie in a plane.
  std::optional<std::vector<std::array<std::uint32_t, 3>>> run() {
    if (!start()) return std::nullopt;
    // Faces that are made on the way stand behind those that have been looked at.
    for (std::uint32_t f = 0; f < faces_.size(); ++f) {
      if (!faces_[f].removed && !faces_[f].above.empty()) add_farthest(f);
    }
    std::vector<std::array<std::uint32_t, 3>> triangles;
    for (const Face& face : faces_) {
      if (!face.removed) triangles.push_back(face.corners);
    }
    return triangles;
  }

 private:
  struct Face {
    std::array<std::uint32_t, 3> corners{};
    std::array<std::uint32_t, 3> beside{};  ///< the face along the edge from corner k to k + 1
    Node normal{};
    std::vector<std::uint32_t> above;  ///< nodes that are left for it
    bool removed = false;
  };

  std::int64_t height(const Face& face, std::uint32_t node) const {
    return dot(face.normal, nodes_[node] - nodes_[face.corners[0]]);
  }

  std::uint32_t add_face(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    faces_.push_back({{a, b, c}, {}, cross(nodes_[b] - nodes_[a], nodes_[c] - nodes_[a]), {}, false});
    return static_cast<std::uint32_t>(faces_.size() - 1);
  }

  /// A tetrahedron: nodes are sorted, so the first and the last differ.
  bool start() {
    const auto count = static_cast<std::uint32_t>(nodes_.size());
    if (count < 4) return false;
    const std::uint32_t a = 0, b = count - 1;
    std::uint32_t c = count, d = count;
    double most = 0;
    for (std::uint32_t i = 1; i < b; ++i) {
      const Node across = cross(nodes_[b] - nodes_[a], nodes_[i] - nodes_[a]);
      const double size =
          std::hypot(static_cast<double>(across[0]), static_cast<double>(across[1]), static_cast<double>(across[2]));
      if (size <= most) continue;
      most = size;
      c = i;
    }
    if (c == count) return false;
    const Node normal = cross(nodes_[b] - nodes_[a], nodes_[c] - nodes_[a]);
    std::int64_t farthest = 0;
    for (std::uint32_t i = 1; i < b; ++i) {
      const std::int64_t height = std::abs(dot(normal, nodes_[i] - nodes_[a]));
      if (height <= farthest) continue;
      farthest = height;
      d = i;
    }
    if (d == count) return false;
    std::array<std::uint32_t, 3> base{a, b, c};
    if (dot(normal, nodes_[d] - nodes_[a]) > 0) std::swap(base[1], base[2]);
    add_face(base[0], base[1], base[2]);
    for (std::size_t k = 0; k < 3; ++k) add_face(base[(k + 1) % 3], base[k], d);
    for (std::uint32_t k = 0; k < 3; ++k) {
      faces_[0].beside[k] = k + 1;
      faces_[k + 1].beside = {0, 1 + (k + 2) % 3, 1 + (k + 1) % 3};
    }
    std::vector<std::uint32_t> all(count);
    for (std::uint32_t i = 0; i < count; ++i) all[i] = i;
    distribute(all, 0);
    return true;
  }

  /// Gives each node to the first of the faces from `first` on that it is above of. Those below all of them are inside.
  void distribute(const std::vector<std::uint32_t>& nodes, std::size_t first) {
    for (const std::uint32_t node : nodes) {
      for (std::size_t f = first; f < faces_.size(); ++f) {
        if (height(faces_[f], node) <= 0) continue;
        faces_[f].above.push_back(node);
        break;
      }
    }
  }

  /// Replaces all faces that see the farthest node of a face by a fan from it to their horizon.
  void add_farthest(std::uint32_t f) {
    std::uint32_t apex = faces_[f].above[0];
    for (const std::uint32_t node : faces_[f].above) {
      if (height(faces_[f], node) > height(faces_[f], apex)) apex = node;
    }
    std::vector<std::uint32_t> left, open{f};
    std::map<std::uint32_t, std::pair<std::uint32_t, std::uint32_t>> horizon;  // source of an edge: its target, the face beyond
    faces_[f].removed = true;
    while (!open.empty()) {
      const std::uint32_t g = open.back();
      open.pop_back();
      left.insert(left.end(), faces_[g].above.begin(), faces_[g].above.end());
      faces_[g].above = {};
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t beyond = faces_[g].beside[k];
        if (faces_[beyond].removed) continue;
        if (height(faces_[beyond], apex) > 0) {
          faces_[beyond].removed = true;
          open.push_back(beyond);
        }
      }
      seen_.push_back(g);
    }
    for (const std::uint32_t g : seen_) {
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t beyond = faces_[g].beside[k];
        if (!faces_[beyond].removed) horizon[faces_[g].corners[k]] = {faces_[g].corners[(k + 1) % 3], beyond};
      }
    }
    seen_.clear();
    const std::size_t first = faces_.size();
    std::map<std::uint32_t, std::uint32_t> made;  // source of an edge: its face
    for (const auto& [source, edge] : horizon) {
      const std::uint32_t face = add_face(source, edge.first, apex);
      made[source] = face;
      faces_[face].beside[0] = edge.second;
      Face& other = faces_[edge.second];
      for (std::size_t k = 0; k < 3; ++k) {
        if (other.corners[k] == edge.first && other.corners[(k + 1) % 3] == source) other.beside[k] = face;
      }
    }
    for (const auto& [source, edge] : horizon) {
      const std::uint32_t face = made.at(source), next = made.at(edge.first);
      faces_[face].beside[1] = next;
      faces_[next].beside[2] = face;
    }
    distribute(left, first);
  }

  const std::vector<Node>& nodes_;
  std::vector<Face> faces_;
  std::vector<std::uint32_t> seen_;
};

/// The corners of a cube around each of some nodes in a plane.
std::vector<Node> thickened(const std::vector<Node>& nodes) {
  std::vector<Node> result;
  for (const Node& node : nodes) {
    for (std::int64_t corner = 0; corner < 8; ++corner) {
      result.push_back({node[0] + 2 * (corner & 1) - 1, node[1] + (corner & 2) - 1, node[2] + (corner & 4) / 2 - 1});
    }
  }
  return result;
}

void sort_once(std::vector<Node>& nodes) {
  std::sort(nodes.begin(), nodes.end());
  nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
}

}  // namespace

Mesh convex_hull(std::span<const Vec3> points) {
  if (points.empty()) throw Error(ErrorCode::invalid_argument, "a convex hull needs at least one point");
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!is_finite(points[i])) throw Error(ErrorCode::invalid_argument, "point " + std::to_string(i) + " is not finite");
  }
  const Box box = bounding_box(points);
  const double side = box.side(box.longest_axis());
  const double step = side > 0 ? side / static_cast<double>(steps) : std::max(norm(box.min), 1.0) * 1e-12;
  std::vector<Node> nodes;
  nodes.reserve(points.size());
  for (const Vec3& x : points) {
    Node& node = nodes.emplace_back();
    for (std::size_t k = 0; k < 3; ++k) node[k] = std::llround((x[k] - box.min[k]) / step);
  }
  sort_once(nodes);
  auto triangles = Quickhull(nodes).run();
  if (!triangles) {
    nodes = thickened(nodes);
    sort_once(nodes);
    triangles = Quickhull(nodes).run();
  }
  Mesh hull;
  std::map<std::uint32_t, PointId> numbers;
  for (const auto& triangle : *triangles) {
    hull.face_sizes.push_back(3);
    for (const std::uint32_t node : triangle) {
      const auto [found, added] = numbers.try_emplace(node, static_cast<PointId>(hull.points.size()));
      hull.face_points.push_back(found->second);
      if (!added) continue;
      Vec3& x = hull.points.emplace_back();
      for (std::size_t k = 0; k < 3; ++k) x[k] = box.min[k] + static_cast<double>(nodes[node][k]) * step;
    }
  }
  return hull;
}

}  // namespace deform
