// SPDX-License-Identifier: Apache-2.0
#include "core/quality/face_pairs.h"

#include <algorithm>
#include <cmath>

#include "core/base/parallel.h"
#include "core/quality/polygon.h"

namespace deform::quality {

namespace {

constexpr std::size_t pairs_per_range = 4096;
constexpr std::size_t most_faces = 4;  // at an edge
constexpr double thinnest = 1e-12;     // area over the square of the way around

/// A face at an edge whose other end is less than `to`.
struct EdgeSide {
  PointId to;
  FaceId face;
};

/// Calls use(from, to, face) for every edge of every face that has a normal; from < to.
template <typename Use>
void for_each_side(const FaceCorners& corners, std::span<const Vec3> normals, const Use& use) {
  for (std::size_t f = 0; f < corners.size(); ++f) {
    if (normals[f] == Vec3{}) continue;
    const auto at = corners[f];
    for (std::size_t c = 0; c < at.size(); ++c) {
      const PointId a = at[c], b = at[c + 1 == at.size() ? 0 : c + 1];
      if (a != b) use(std::min(a, b), std::max(a, b), static_cast<FaceId>(f));
    }
  }
}

/// Calls use(pair) for the pairs of faces at the edges of one point; sides are sorted.
template <typename Use>
void for_each_pair(PointId from, std::span<const EdgeSide> sides, const Use& use) {
  for (std::size_t begin = 0; begin < sides.size();) {
    std::size_t end = begin + 1;
    while (end < sides.size() && sides[end].to == sides[begin].to) ++end;
    for (std::size_t i = begin; i < end && end - begin <= most_faces; ++i) {
      for (std::size_t j = i + 1; j < end; ++j) {
        if (sides[i].face != sides[j].face) use(FacePair{sides[i].face, sides[j].face, from, sides[i].to, 0, 0});
      }
    }
    begin = end;
  }
}

}  // namespace

FaceCorners::FaceCorners(const Mesh& mesh) : mesh_(mesh) {
  if (mesh.face_sizes.empty()) return;
  equal_ = mesh.face_sizes[0];
  if (std::any_of(mesh.face_sizes.begin(), mesh.face_sizes.end(), [&](std::uint32_t size) { return size != equal_; })) {
    equal_ = 0;
    offsets_ = mesh.face_offsets();
  }
}

Vec3 unit_normal(std::span<const Vec3> points, std::span<const PointId> corners, double rounding) {
  const Vec3 area = vector_area(points, corners);
  double squares = 0;
  for (std::size_t c = 0; c < corners.size(); ++c) {
    const Vec3 edge = points[corners[c + 1 == corners.size() ? 0 : c + 1]] - points[corners[c]];
    squares += dot(edge, edge);
  }
  const double size = length(area), around = std::sqrt(static_cast<double>(corners.size()) * squares);  // or a little less
  if (!(size > around * (thinnest * around + rounding)) || !std::isfinite(size)) return {};
  return (1 / size) * area;
}

// The linear map of the plane of the face that fits its corners best, exact for triangles, by the squares of its singular values.
bool is_crushed(std::span<const Vec3> rest, std::span<const Vec3> points, std::span<const PointId> corners, const Vec3& normal) {
  constexpr double half = 0.25;  // squared
  const Vec3 from = mean_of(rest, corners), to = mean_of(points, corners);
  const Vec3 along = rest[corners[0]] - from;
  const Vec3 x = along - dot(along, normal) * normal, y = cross(normal, x);  // of one length
  double aa = 0, ab = 0, bb = 0;
  Vec3 ga{}, gb{};
  for (const PointId p : corners) {
    const Vec3 before = rest[p] - from, after = points[p] - to;
    const double a = dot(before, x), b = dot(before, y);
    aa += a * a;
    ab += a * b;
    bb += b * b;
    ga = ga + a * after;
    gb = gb + b * after;
  }
  const double det = aa * bb - ab * ab, scale = dot(x, x);
  if (!(det > 0)) return false;
  const Vec3 fx = (scale / det) * (bb * ga - ab * gb), fy = (scale / det) * (aa * gb - ab * ga);
  const double p = dot(fx, fx) / scale, q = dot(fx, fy) / scale, r = dot(fy, fy) / scale;
  const double spread = std::sqrt((p - r) * (p - r) + 4 * q * q), least = (p + r - spread) / 2, most = (p + r + spread) / 2;
  return least < half && least < half * most;
}

// Normals of warped faces are not exactly perpendicular to their edges: the component along the edge is ignored.
Turn turn_between(const Vec3& normal, const Vec3& next, const Vec3& edge) {
  const double size = length(edge);
  if (!(size > 0) || !std::isfinite(size)) return {};
  const Vec3 e = (1 / size) * edge;
  const double cosine = dot(normal, next) - dot(normal, e) * dot(next, e), sine = dot(cross(normal, next), e);
  const double both = std::sqrt(cosine * cosine + sine * sine);
  if (!(both > 1e-6)) return {};
  return {cosine / both, sine / both};
}

Vec3 turned_normal(const Vec3& normal, const Turn& turn, const Vec3& edge) {
  const Vec3 e = (1 / length(edge)) * edge;
  const Vec3 across = normal - dot(normal, e) * e;
  const Vec3 turned = turn.cosine * across + turn.sine * cross(e, across);
  const double size = length(turned);
  return size > 1e-6 ? (1 / size) * turned : Vec3{};
}

std::vector<FacePair> face_pairs(const Mesh& mesh, const FaceCorners& corners, std::span<const Vec3> rest,
                                 std::span<const Vec3> normals, const RunContext& context) {
  std::vector<std::uint64_t> offsets(mesh.point_count() + 1);
  for_each_side(corners, normals, [&](PointId from, PointId, FaceId) { ++offsets[from + 1]; });
  for (std::size_t i = 1; i < offsets.size(); ++i) offsets[i] += offsets[i - 1];
  context.check();
  std::vector<EdgeSide> sides(static_cast<std::size_t>(offsets.back()));
  {
    std::vector<std::uint64_t> next(offsets.begin(), offsets.end() - 1);
    for_each_side(corners, normals, [&](PointId from, PointId to, FaceId face) { sides[next[from]++] = {to, face}; });
  }
  parallel_for(context, mesh.point_count(), pairs_per_range, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      std::sort(sides.begin() + static_cast<std::ptrdiff_t>(offsets[i]),
                sides.begin() + static_cast<std::ptrdiff_t>(offsets[i + 1]),
                [](const EdgeSide& a, const EdgeSide& b) { return a.to != b.to ? a.to < b.to : a.face < b.face; });
    }
  });
  const auto for_all = [&](const auto& use) {
    for (std::size_t i = 0; i < mesh.point_count(); ++i) {
      const std::size_t count = static_cast<std::size_t>(offsets[i + 1] - offsets[i]);
      for_each_pair(static_cast<PointId>(i), std::span(sides).subspan(offsets[i], count), use);
    }
  };
  std::size_t count = 0;
  for_all([&](const FacePair&) { ++count; });
  std::vector<FacePair> pairs;
  pairs.reserve(count);
  for_all([&](const FacePair& pair) { pairs.push_back(pair); });
  parallel_for(context, pairs.size(), pairs_per_range, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      FacePair& pair = pairs[i];
      const Turn turn = turn_between(normals[pair.first], normals[pair.second], rest[pair.to] - rest[pair.from]);
      pair.cosine = static_cast<float>(turn.cosine);
      pair.sine = static_cast<float>(turn.sine);
    }
  });
  std::erase_if(pairs, [](const FacePair& pair) { return pair.cosine == 0 && pair.sine == 0; });
  return pairs;
}

// Where all edges have four faces there are three pairs for two corners.
std::size_t face_pairs_bytes(std::size_t points, std::size_t corners) {
  return 16 * (points + 1) + corners * (sizeof(EdgeSide) + 3 * sizeof(FacePair) / 2);
}

}  // namespace deform::quality
