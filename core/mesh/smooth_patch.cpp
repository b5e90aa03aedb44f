// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/smooth_patch.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "core/base/vectors.h"

namespace deform {

namespace {

constexpr double degrees_per_radian = 57.295779513082320877;

/// The squared distance of a place from a triangle (Ericson, Real-Time Collision Detection, 5.1.5).
double squared_distance_from(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c) {
  const Vec3 ab = b - a, ac = c - a;
  const auto at = [&](double v, double w) { return squared_distance(p, a + v * ab + w * ac); };
  const double d1 = dot(ab, p - a), d2 = dot(ac, p - a), d3 = dot(ab, p - b), d4 = dot(ac, p - b);
  const double d5 = dot(ab, p - c), d6 = dot(ac, p - c);
  if (d1 <= 0 && d2 <= 0) return at(0, 0);
  if (d3 >= 0 && d4 <= d3) return at(1, 0);
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0 && d1 > d3) return at(d1 / (d1 - d3), 0);
  if (d6 >= 0 && d5 <= d6) return at(0, 1);
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0 && d2 > d6) return at(0, d2 / (d2 - d6));
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0 && d4 - d3 + (d5 - d6) > 0) {
    const double w = (d4 - d3) / (d4 - d3 + (d5 - d6));
    return at(1 - w, w);
  }
  const double sum = va + vb + vc;
  if (!(sum > 0)) return std::min({at(0, 0), at(1, 0), at(0, 1)});  // no area
  return at(vb / sum, vc / sum);
}

std::vector<std::size_t> offsets_of(const SurfaceFaces& surface) {
  std::vector<std::size_t> offsets{0};
  for (const std::uint32_t size : surface.sizes) offsets.push_back(offsets.back() + size);
  return offsets;
}

/// An edge of a face, its ends ascending.
struct FaceEdge {
  PointId low, high;
  bool ascending;  ///< the face runs from low to high
  std::size_t face;
};

/// The edges of all faces, those between the same points together.
std::vector<FaceEdge> edges_of(const SurfaceFaces& surface, const std::vector<std::size_t>& offsets) {
  std::vector<FaceEdge> edges;
  edges.reserve(surface.corners.size());
  for (std::size_t f = 0; f < surface.sizes.size(); ++f) {
    const auto corners = surface.corners.subspan(offsets[f], surface.sizes[f]);
    if (corners.size() < 3) continue;
    for (std::size_t c = 0; c < corners.size(); ++c) {
      const PointId from = corners[c], to = corners[c + 1 == corners.size() ? 0 : c + 1];
      if (from != to) edges.push_back({std::min(from, to), std::max(from, to), from < to, f});
    }
  }
  std::sort(edges.begin(), edges.end(),
            [](const FaceEdge& a, const FaceEdge& b) { return std::pair(a.low, a.high) < std::pair(b.low, b.high); });
  return edges;
}

/// Twice the vector area, about the first corner.
Vec3 normal_of(std::span<const Vec3> points, std::span<const PointId> corners) {
  Vec3 sum{};
  for (std::size_t c = 1; c + 1 < corners.size(); ++c) {
    sum = sum + cross(points[corners[c]] - points[corners[0]], points[corners[c + 1]] - points[corners[0]]);
  }
  return sum;
}

/// Faces that a flood may go between, each pair both ways.
class Neighbours {
 public:
  Neighbours(const SurfaceFaces& surface, double angle) : first_(surface.sizes.size() + 1) {
    const auto offsets = offsets_of(surface);
    std::vector<Vec3> normals(surface.sizes.size());
    for (std::size_t f = 0; f < normals.size(); ++f) {
      normals[f] = normal_of(surface.points, surface.corners.subspan(offsets[f], surface.sizes[f]));
    }
    const auto edges = edges_of(surface, offsets);
    std::vector<std::pair<std::size_t, std::size_t>> pairs;
    for (std::size_t i = 0; i < edges.size();) {
      std::size_t end = i + 1;
      while (end < edges.size() && edges[end].low == edges[i].low && edges[end].high == edges[i].high) ++end;
      if (end == i + 2 && smooth(edges[i], edges[i + 1], normals, angle)) pairs.emplace_back(edges[i].face, edges[i + 1].face);
      i = end;
    }
    for (const auto& [a, b] : pairs) {
      ++first_[a + 1];
      ++first_[b + 1];
    }
    for (std::size_t f = 1; f < first_.size(); ++f) first_[f] += first_[f - 1];
    of_.resize(first_.back());
    std::vector<std::size_t> next(first_.begin(), first_.end() - 1);
    for (const auto& [a, b] : pairs) {
      of_[next[a]++] = b;
      of_[next[b]++] = a;
    }
  }

  std::span<const std::size_t> of(std::size_t face) const {
    return std::span(of_).subspan(first_[face], first_[face + 1] - first_[face]);
  }

 private:
  static bool smooth(const FaceEdge& a, const FaceEdge& b, const std::vector<Vec3>& normals, double angle) {
    const Vec3& m = normals[a.face];
    const Vec3 n = a.ascending == b.ascending ? -1 * normals[b.face] : normals[b.face];
    if (m == Vec3{} || n == Vec3{}) return false;
    return std::atan2(norm(cross(m, n)), dot(m, n)) * degrees_per_radian <= angle;
  }

  std::vector<std::size_t> first_, of_;
};

}  // namespace

NearestFace nearest_face(const SurfaceFaces& surface, const Vec3& place) {
  double least = std::numeric_limits<double>::infinity();
  std::size_t nearest = surface.sizes.size();
  const auto offsets = offsets_of(surface);
  for (std::size_t f = 0; f < surface.sizes.size(); ++f) {
    const auto corners = surface.corners.subspan(offsets[f], surface.sizes[f]);
    if (corners.size() < 3) continue;
    Vec3 middle{};
    for (const PointId p : corners) middle = middle + surface.points[p] / static_cast<double>(corners.size());
    for (std::size_t c = 0; c < corners.size(); ++c) {
      const Vec3 &a = surface.points[corners[c]], &b = surface.points[corners[c + 1 == corners.size() ? 0 : c + 1]];
      const bool triangle = corners.size() == 3;
      const double away = squared_distance_from(place, a, b, triangle ? surface.points[corners[2]] : middle);
      if (away < least) {
        least = away;
        nearest = f;
      }
      if (triangle) break;
    }
  }
  return {nearest, std::sqrt(least)};
}

std::vector<char> smooth_patch(const SurfaceFaces& surface, std::span<const std::size_t> seeds, double angle) {
  const Neighbours neighbours(surface, angle);
  std::vector<char> marked(surface.sizes.size());
  std::vector<std::size_t> open(seeds.begin(), seeds.end());
  for (const std::size_t f : open) marked[f] = 1;
  while (!open.empty()) {
    const std::size_t face = open.back();
    open.pop_back();
    for (const std::size_t f : neighbours.of(face)) {
      if (marked[f]) continue;
      marked[f] = 1;
      open.push_back(f);
    }
  }
  return marked;
}

}  // namespace deform
