// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/detection/surface.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/numerics/dense/decompositions.h"

namespace deform::detection {

namespace {

constexpr std::size_t grain = 8192;
constexpr double same_plane = 1e-4;  ///< angle of faces that are one

/// One side of an edge.
struct Side {
  PointId low, high;
  FaceId face;
  bool forward;  ///< runs from low to high
};

Vector3d vector_of(const Vec3& p) { return {p[0], p[1], p[2]}; }

double angle_between(const Vector3d& a, const Vector3d& b) { return std::atan2(a.cross(b).norm(), a.dot(b)); }

}  // namespace

Surface::Surface(const Mesh& mesh, const RunContext& context) : offsets(mesh.face_offsets()) {
  join_points(mesh);
  scale(mesh);
  measure_faces(context);
  context.check();
  connect();
  orient();
}

void Surface::join_points(const Mesh& mesh) {
  std::vector<PointId> order(mesh.point_count());
  std::iota(order.begin(), order.end(), PointId{0});
  std::sort(order.begin(), order.end(),
            [&](PointId a, PointId b) { return mesh.points[a] != mesh.points[b] ? mesh.points[a] < mesh.points[b] : a < b; });
  std::vector<PointId> joined(mesh.point_count());
  for (std::size_t i = 0; i < order.size(); ++i) {
    const bool same = i > 0 && mesh.points[order[i]] == mesh.points[order[i - 1]];
    joined[order[i]] = same ? joined[order[i - 1]] : order[i];
  }
  joined_corners.resize(mesh.face_points.size());
  for (std::size_t i = 0; i < joined_corners.size(); ++i) joined_corners[i] = joined[mesh.face_points[i]];
}

void Surface::scale(const Mesh& mesh) {
  // The middle weighted by area, so that neither rotation nor sampling moves it.
  const Vector3d rough = joined_corners.empty() ? Vector3d(0, 0, 0) : vector_of(mesh.points[joined_corners[0]]);
  const double unit = bounding_box(mesh.points, joined_corners).diagonal();
  Vector3d sum = Vector3d::Zero();
  double weight = 0;
  for (std::size_t f = 0; unit > 0 && f + 1 < offsets.size(); ++f) {
    const auto ids = corners(f);
    Vector3d twice = Vector3d::Zero(), mean = Vector3d::Zero();
    for (std::size_t i = 0; i < ids.size(); ++i) {
      const Vector3d a = (vector_of(mesh.points[ids[i]]) - rough) / unit;
      const Vector3d b = (vector_of(mesh.points[ids[(i + 1) % ids.size()]]) - rough) / unit;
      twice += a.cross(b);
      mean += a / static_cast<double>(ids.size());
    }
    sum += twice.norm() * mean;
    weight += twice.norm();
  }
  if (!(weight > 1e-24))
    throw Error(ErrorCode::invalid_argument, "mesh: has no face with an area, so there is nothing to detect");
  middle = rough + sum / weight * unit;
  double farthest = 0;
  for (const PointId p : joined_corners) farthest = std::max(farthest, (vector_of(mesh.points[p]) - middle).norm());
  size = 2 * farthest;
  points.resize(mesh.point_count());
  for (std::size_t i = 0; i < points.size(); ++i) points[i] = (vector_of(mesh.points[i]) - middle) / size;
}

void Surface::measure_faces(const RunContext& context) {
  const std::size_t faces = offsets.size() - 1;
  normal.assign(faces, Vector3d::Zero());
  centre.assign(faces, Vector3d::Zero());
  area.assign(faces, 0);
  height.assign(faces, 0);
  parallel_for(context, faces, grain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t f = begin; f < end; ++f) {
      const auto ids = corners(f);
      const double n = static_cast<double>(ids.size());
      Vector3d mean = Vector3d::Zero(), twice = Vector3d::Zero();
      for (const PointId p : ids) mean += points[p] / n;
      double longest = 0;
      for (std::size_t i = 0; i < ids.size(); ++i) {
        const Vector3d& a = points[ids[i]];
        const Vector3d& b = points[ids[(i + 1) % ids.size()]];
        twice += (a - mean).cross(b - mean);
        longest = std::max(longest, (b - a).norm());
      }
      centre[f] = mean;
      const double norm = twice.norm();
      // Below this the normal is rounding.
      if (ids.size() < 3 || !(norm > 1e-13 * longest) || !(norm > 1e-10 * longest * longest)) continue;
      area[f] = norm / 2;
      normal[f] = twice / norm;
      height[f] = norm / longest;
    }
  });
  for (const double a : area) total_area += a;
  if (!(total_area > 0))
    throw Error(ErrorCode::invalid_argument, "mesh: has no face with an area, so there is nothing to detect");
  model_area = total_area * size * size;
}

void Surface::connect() {
  std::vector<Side> sides;
  sides.reserve(joined_corners.size());
  for (std::size_t f = 0; f < face_count(); ++f) {
    const auto ids = corners(f);
    if (ids.size() < 3) continue;
    for (std::size_t i = 0; i < ids.size(); ++i) {
      const PointId a = ids[i], b = ids[(i + 1) % ids.size()];
      if (a != b) sides.push_back({std::min(a, b), std::max(a, b), static_cast<FaceId>(f), a < b});
    }
  }
  std::sort(sides.begin(), sides.end(), [](const Side& a, const Side& b) {
    return a.low != b.low ? a.low < b.low : a.high != b.high ? a.high < b.high : a.face < b.face;
  });
  // Every pair of an edge; of an edge with very many faces only those next to each other in the list.
  struct Pair {
    FaceId face;
    Neighbour neighbour;
  };
  std::vector<Pair> pairs;
  pairs.reserve(sides.size());
  for (std::size_t begin = 0, end = 0; begin < sides.size(); begin = end) {
    while (end < sides.size() && sides[end].low == sides[begin].low && sides[end].high == sides[begin].high) ++end;
    for (std::size_t i = begin; i < end; ++i) {
      const std::size_t last = end - begin > 6 ? std::min(end, i + 2) : end;
      for (std::size_t k = i + 1; k < last; ++k) {
        const Side &a = sides[i], &b = sides[k];
        if (a.face == b.face) continue;
        const bool without = area[a.face] == 0 || area[b.face] == 0;
        const bool against = a.forward == b.forward;
        const Vector3d other = against ? Vector3d(-normal[b.face]) : normal[b.face];
        const double angle = without ? 0 : angle_between(normal[a.face], other);
        pairs.push_back({a.face, {b.face, a.low, a.high, against, angle}});
        pairs.push_back({b.face, {a.face, a.low, a.high, against, angle}});
      }
    }
  }
  first.assign(face_count() + 1, 0);
  for (const Pair& pair : pairs) ++first[pair.face + 1];
  for (std::size_t f = 0; f < face_count(); ++f) first[f + 1] += first[f];
  adjacent.resize(pairs.size());
  std::vector<std::uint64_t> next(first.begin(), first.end() - 1);
  for (const Pair& pair : pairs) adjacent[next[pair.face]++] = pair.neighbour;
}

void Surface::orient() {
  std::vector<char> seen(face_count(), 0), turned(face_count(), 0);
  std::vector<FaceId> front;
  for (std::size_t start = 0; start < face_count(); ++start) {
    if (seen[start] || area[start] == 0) continue;
    seen[start] = 1;
    front.assign(1, static_cast<FaceId>(start));
    while (!front.empty()) {
      const FaceId f = front.back();
      front.pop_back();
      for (const Neighbour& n : neighbours(f)) {
        if (seen[n.face] || area[n.face] == 0) continue;
        seen[n.face] = 1;
        turned[n.face] = n.against != (turned[f] != 0) ? 1 : 0;
        if (turned[n.face]) normal[n.face] = -normal[n.face];
        front.push_back(n.face);
      }
    }
  }
}

void Surface::find_passages(double angle) {
  maximum_angle = angle;
  first_passage.assign(1, 0);
  passage.clear();
  least_cosine.resize(face_count());
  level.assign(face_count(), 0);
  for (std::size_t f = 0; f < face_count(); ++f) {
    for (const Neighbour& n : neighbours(f)) {
      if (passable(f, n)) passage.push_back(n.face);
      if (n.angle < same_plane) level[f] = 1;
    }
    first_passage.push_back(passage.size());
    // Half the maximum angle plus the effect of noise.
    const double off = maximum_angle / 2 * (1 + 1e-6) + allowance(f);
    least_cosine[f] = off < 1.5 ? std::cos(off) : -1;
  }
}

FitData Surface::data(std::span<const FaceId> faces, std::size_t most) const {
  FitData data;
  const std::size_t stride = std::max<std::size_t>(1, faces.size() / most);
  for (std::size_t i = 0; i < faces.size(); i += stride) {
    const FaceId f = faces[i];
    if (area[f] == 0) continue;
    const auto ids = corners(f);
    if (faces.size() >= 200) {
      data.corners.push_back(points[ids[i / stride % ids.size()]]);
      data.corner_weights.push_back(area[f]);
    } else {
      for (const PointId p : ids) {
        data.corners.push_back(points[p]);
        data.corner_weights.push_back(area[f] / static_cast<double>(ids.size()));
      }
    }
    data.centres.push_back(centre[f]);
    data.normals.push_back(normal[f]);
    data.weights.push_back(area[f]);
  }
  return data;
}

namespace {

/// Points of the second ring of faces around `start` that is not behind a sharp edge.
void surroundings(const Surface& surface, FaceId start, double sharp, std::vector<FaceId>& faces, std::vector<PointId>& points) {
  faces.assign(1, start);
  std::size_t begin = 0;
  for (int ring = 0; ring < 3; ++ring) {
    const std::size_t end = faces.size();
    for (; begin < end; ++begin) {
      for (const Neighbour& n : surface.neighbours(faces[begin])) {
        if (n.angle <= sharp && faces.size() < 64 && std::find(faces.begin(), faces.end(), n.face) == faces.end()) {
          faces.push_back(n.face);
        }
      }
    }
  }
  points.clear();
  for (const FaceId f : faces) {
    for (const PointId p : surface.corners(f)) points.push_back(p);
  }
  std::sort(points.begin(), points.end());
  points.erase(std::unique(points.begin(), points.end()), points.end());
}

/// Standard deviation from the best quadratic height field, or -1.
double deviation(const Surface& surface, FaceId face, std::span<const PointId> ids) {
  constexpr Eigen::Index terms = 6;
  const auto n = static_cast<Eigen::Index>(ids.size());
  if (n < terms + 3) return -1;
  const Vector3d axis = surface.normal[face], e1 = axis.unitOrthogonal(), e2 = axis.cross(e1);
  double radius = 0;
  for (const PointId p : ids) radius = std::max(radius, (surface.points[p] - surface.centre[face]).norm());
  Eigen::MatrixXd basis(n, terms);
  Eigen::VectorXd heights(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Vector3d q = (surface.points[ids[static_cast<std::size_t>(i)]] - surface.centre[face]) / radius;
    const double x = q.dot(e1), y = q.dot(e2);
    basis.row(i) << 1, x, y, x * x, x * y, y * y;
    heights[i] = q.dot(axis);
  }
  const PivotedSolution fit = pivoted_solution(basis, heights);
  const double left = (heights - basis * fit.x).squaredNorm();
  const auto freedom = n - fit.rank;
  return freedom > 0 ? radius * std::sqrt(left / static_cast<double>(freedom)) : -1;
}

}  // namespace

double estimated_noise(const Surface& surface, double sharp, const RunContext& context) {
  constexpr std::size_t most = 4000;
  constexpr double most_bent = 0.94;  // cosine of 20 degrees
  const std::size_t stride = std::max<std::size_t>(1, surface.face_count() / most);
  const std::size_t samples = (surface.face_count() + stride - 1) / stride;
  std::vector<double> found(samples, -1);
  parallel_for(context, samples, 64, [&](std::size_t begin, std::size_t end) {
    std::vector<FaceId> faces;
    std::vector<PointId> points;
    for (std::size_t i = begin; i < end; ++i) {
      const auto face = static_cast<FaceId>(i * stride);
      if (surface.area[face] == 0) continue;
      surroundings(surface, face, sharp, faces, points);
      // A strongly bent neighbourhood is no quadratic surface, with or without noise.
      const bool bent = std::any_of(faces.begin(), faces.end(), [&](FaceId f) {
        return surface.area[f] > 0 && surface.normal[f].dot(surface.normal[face]) < most_bent;
      });
      if (bent) continue;
      found[i] = deviation(surface, face, points);
    }
  });
  std::erase_if(found, [](double d) { return d < 0; });
  if (found.size() < 8) return 0;
  const auto quartile = found.begin() + static_cast<std::ptrdiff_t>(found.size() / 4);
  std::nth_element(found.begin(), quartile, found.end());
  return *quartile;
}

}  // namespace deform::detection
