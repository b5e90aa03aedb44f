// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/detection/judgement.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace deform::detection {

namespace {

constexpr std::size_t fit_faces = 600;
constexpr std::size_t judged_faces = 2000;
constexpr int terms = 20;  ///< monomials in x, y, z up to degree 3
constexpr std::size_t few_points = 3 * terms;
// Measured: noise and facets have a restlessness of 0.8 to 1.3; free forms below 0.19, or up to 0.57 with a systematic part
// from 0.67.
constexpr double noise_restlessness = 0.7;
constexpr double least_restlessness = 0.25;
constexpr double largest_systematic = 0.65;
// Measured on cars, wings and hulls: free-form panels taken for cylinders and cones turn by 2 to 9 degrees, or by up to 20 with a
// restlessness below 0.25, with a sagitta of 30 to 390 times the distance of their points; those that turn by more, of up to 60
// times. Parts from CAD have 10 degrees and more, 350 times and a restlessness from 0.85.
constexpr double shallow_turn = 0.52, least_turn = 0.16;  ///< radians

/// Unique corners of at most about `most` faces.
std::vector<PointId> points_of(const Surface& surface, std::span<const FaceId> faces, std::size_t most) {
  const std::size_t stride = std::max<std::size_t>(1, faces.size() / most);
  std::vector<PointId> points;
  for (std::size_t i = 0; i < faces.size(); i += stride) {
    for (const PointId p : surface.corners(faces[i])) points.push_back(p);
  }
  std::sort(points.begin(), points.end());
  points.erase(std::unique(points.begin(), points.end()), points.end());
  return points;
}

/// Directions of faces that differ by half a degree at least, counted up to `enough`.
std::size_t directions(const Surface& surface, std::span<const FaceId> faces, std::size_t enough) {
  const double same = std::cos(0.0087);
  std::vector<Vector3d> found;
  for (const FaceId f : faces) {
    if (surface.area[f] == 0) continue;
    const Vector3d& n = surface.normal[f];
    if (std::any_of(found.begin(), found.end(), [&](const Vector3d& m) { return std::abs(m.dot(n)) > same; })) continue;
    found.push_back(n);
    if (found.size() >= enough) break;
  }
  return found.size();
}

/// All edges of the faces that lead out of the region are sharp or rims.
bool bounded_by_sharp_edges(const Surface& surface, const Limits& limits, const Region& region) {
  for (const FaceId f : region.faces) {
    for (const Neighbour& n : surface.neighbours(f)) {
      const bool inside = std::find(region.faces.begin(), region.faces.end(), n.face) != region.faces.end();
      if (!inside && n.angle <= limits.maximum_angle) return false;
    }
  }
  return true;
}

struct Residuals {
  double systematic = 0;  ///< rms of the part explained by the polynomial, less that expected from noise
  double random = 0;      ///< standard deviation of the rest
};

Residuals residuals(const Surface& surface, const Shape& shape, std::span<const PointId> points) {
  Vector3d middle = Vector3d::Zero();
  for (const PointId p : points) middle += surface.points[p] / static_cast<double>(points.size());
  double radius = 0;
  for (const PointId p : points) radius = std::max(radius, (surface.points[p] - middle).norm());
  Eigen::Matrix<double, terms, terms> normal = Eigen::Matrix<double, terms, terms>::Zero();
  Eigen::Matrix<double, terms, 1> right = Eigen::Matrix<double, terms, 1>::Zero(), row;
  double squares = 0;
  for (const PointId p : points) {
    // The foot on the shape: at the point itself the equation of the shape, a polynomial, is its distance.
    const Shape::Foot foot = shape.foot(surface.points[p]);
    const double d = foot.distance;
    const Vector3d q = (surface.points[p] - d * foot.normal - middle) / radius;
    const double x = q[0], y = q[1], z = q[2];
    row << 1, x, y, z, x * x, y * y, z * z, x * y, x * z, y * z, x * x * x, y * y * y, z * z * z, x * x * y, x * x * z, y * y * x,
        y * y * z, z * z * x, z * z * y, x * y * z;
    normal.noalias() += row * row.transpose();
    right.noalias() += d * row;
    squares += d * d;
  }
  const double n = static_cast<double>(points.size());
  // The monomials are not independent on the shape itself.
  normal.diagonal().array() += 1e-9 * n;
  const double explained = std::clamp(right.dot(normal.ldlt().solve(right)), 0.0, squares);
  const double rest = (squares - explained) / (n - terms);
  return {std::sqrt(std::max(0.0, explained - terms * rest) / n), std::sqrt(rest)};
}

/// How much the residual jumps along edges over how large it is (von Neumann's ratio): 1 for noise, near 0 where it
/// swings slowly.
double restlessness(const Surface& surface, const Shape& shape, std::span<const FaceId> faces, std::size_t most) {
  const std::size_t stride = std::max<std::size_t>(1, faces.size() / most);
  double jumps = 0, squares = 0;
  for (std::size_t i = 0; i < faces.size(); i += stride) {
    const auto ids = surface.corners(faces[i]);
    for (std::size_t k = 0; k < ids.size(); ++k) {
      const double a = shape.distance(surface.points[ids[k]]), b = shape.distance(surface.points[ids[(k + 1) % ids.size()]]);
      jumps += (a - b) * (a - b) / 2;
      squares += a * a;
    }
  }
  return squares > 0 ? jumps / squares : 1;
}

/// Whether most of the area consists of faces with a neighbour in the same plane: a coarse model that was meshed again.
bool faceted(const Surface& surface, std::span<const FaceId> faces, std::size_t most) {
  const std::size_t stride = std::max<std::size_t>(1, faces.size() / most);
  double flat = 0, all = 0;
  for (std::size_t i = 0; i < faces.size(); i += stride) {
    flat += surface.level[faces[i]] ? surface.area[faces[i]] : 0;
    all += surface.area[faces[i]];
  }
  return flat > 0.5 * all;
}

/// Length of the edge and of the triangle's or polygon's extent across it.
double extent_across(const Surface& surface, FaceId face, double edge) { return edge > 0 ? surface.area[face] / edge : 0; }

/// Whether the region is one row of faces of a smooth surface that goes on beside it in rows as wide: any row of a torus lies on
/// a cone and on a sphere, any strip of a ruled surface on a plane. Where residuals are not negligible, also two or three rows:
/// less than half of the points are inside.
bool row_of_smooth_surface(const Surface& surface, const Limits& limits, const Region& region) {
  constexpr std::size_t most = 4000;
  if (region.faces.size() > most) return false;
  std::vector<FaceId> members = region.faces;
  std::sort(members.begin(), members.end());
  std::vector<PointId> on_rim;
  double rim_length = 0, going_on = 0;
  const bool plane = region.shape.kind == PrimitiveKind::plane;
  const double smooth = (plane ? 1 : 1.2) * limits.maximum_angle;  // noise in rows of torus that bend as much as they may
  for (const FaceId f : members) {
    const auto ids = surface.corners(f);
    const auto neighbours = surface.neighbours(f);
    for (std::size_t i = 0; i < ids.size() && surface.area[f] > 0; ++i) {
      const auto [low, high] = std::minmax(ids[i], ids[(i + 1) % ids.size()]);
      const double length = (surface.points[high] - surface.points[low]).norm();
      bool inside = false, similar = false;
      for (const Neighbour& n : neighbours) {
        if (n.from != low || n.to != high) continue;
        inside = inside || std::binary_search(members.begin(), members.end(), n.face);
        const double here = extent_across(surface, f, length), there = extent_across(surface, n.face, length);
        similar = similar || (n.angle > 1e-3 && n.angle <= smooth && there < 2.5 * here && here < 2.5 * there);
      }
      if (inside) continue;
      on_rim.insert(on_rim.end(), {low, high});
      rim_length += length;
      going_on += similar ? length : 0;
    }
  }
  if (going_on < (plane ? 0.6 : 0.4) * rim_length) return false;
  std::sort(on_rim.begin(), on_rim.end());
  on_rim.erase(std::unique(on_rim.begin(), on_rim.end()), on_rim.end());
  const std::size_t points = points_of(surface, members, most).size();
  return points == on_rim.size() || (region.rms > limits.tolerance / 40 && points < 2 * on_rim.size());
}

/// How far the shape turns over the points, radians: around the axis of a cylinder, of a cone as if it was unrolled, from side to
/// side of a sphere.
double turn_of(const Surface& surface, const Shape& shape, std::span<const PointId> points) {
  if (shape.kind == PrimitiveKind::sphere) {
    Vector3d middle = Vector3d::Zero();
    for (const PointId p : points) middle += (surface.points[p] - shape.point).normalized();
    if (middle.norm() < 1e-6 * static_cast<double>(points.size())) return 2 * std::numbers::pi;
    middle.normalize();
    double least = 1;
    for (const PointId p : points) least = std::min(least, (surface.points[p] - shape.point).normalized().dot(middle));
    return 2 * std::acos(std::max(-1.0, least));
  }
  const Vector3d e1 = shape.axis.unitOrthogonal(), e2 = shape.axis.cross(e1);
  std::vector<double> around;
  for (const PointId p : points) {
    const Vector3d q = surface.points[p] - shape.point;
    around.push_back(std::atan2(q.dot(e2), q.dot(e1)));
  }
  std::sort(around.begin(), around.end());
  double gap = around.front() + 2 * std::numbers::pi - around.back();
  for (std::size_t i = 1; i < around.size(); ++i) gap = std::max(gap, around[i] - around[i - 1]);
  return (2 * std::numbers::pi - gap) * shape.cosine;
}

}  // namespace

Region simplest(const Surface& surface, const Limits& limits, const Region& region) {
  const FitData data = surface.data(region.faces, fit_faces);
  struct Candidate {
    Shape shape;
    double distance, angle;
  };
  std::vector<Candidate> candidates;
  double least = region.rms;
  for (const PrimitiveKind kind : limits.kinds) {
    const auto shape = kind == region.shape.kind ? refine(region.shape, data, Effort::full) : fitted(kind, data, Effort::full);
    if (!shape) continue;
    candidates.push_back({*shape, rms_distance(*shape, data), rms_angle(*shape, data)});
    least = std::min(least, candidates.back().distance);
  }
  // That something is curved at all must show clearly: a sphere of huge radius always fits noise a little better than a plane.
  std::erase_if(candidates, [&](const Candidate& c) {
    return c.distance > std::max((c.shape.kind == PrimitiveKind::plane ? 2 : 1.15) * least, limits.tolerance / 40);
  });
  if (candidates.empty()) return region;
  // Simple kinds first: a later one must be clearly closer in direction. The sphere comes last: whatever is one row of faces lies
  // on one.
  const auto rank = [](PrimitiveKind kind) { return kind == PrimitiveKind::sphere ? 9 : static_cast<int>(kind); };
  std::sort(candidates.begin(), candidates.end(),
            [&](const Candidate& a, const Candidate& b) { return rank(a.shape.kind) < rank(b.shape.kind); });
  const Candidate* best = nullptr;
  for (const Candidate& c : candidates) {
    const bool strict = c.shape.kind == PrimitiveKind::cone || (best && best->shape.kind == PrimitiveKind::plane);
    if (!best || c.angle < (strict ? 0.8 : 0.95) * best->angle - 1e-6) best = &c;
  }
  Region result = region;
  result.shape = best->shape;
  result.rms = best->distance;
  return result;
}

bool noisy(const Surface& surface, const Limits& limits, const Shape& shape, std::span<const FaceId> faces) {
  const std::vector<PointId> points = points_of(surface, faces, judged_faces / 4);
  if (points.size() < few_points) return true;
  const Residuals r = residuals(surface, shape, points);
  return r.systematic <= std::max(limits.tolerance / 40, r.random);
}

bool evident(const Surface& surface, const Region& region) {
  const Shape& shape = region.shape;
  if (shape.kind == PrimitiveKind::plane) return true;
  const std::vector<PointId> points = points_of(surface, region.faces, judged_faces);
  const double turn = turn_of(surface, shape, points), radius = shape.radius / shape.cosine;
  const double sagitta = radius * (1 - std::cos(std::min(turn, std::numbers::pi) / 2));
  const double off = std::max({region.rms, surface.noise, 1e-12});
  if (turn >= shallow_turn) return sagitta >= (region.rms <= 3 * surface.noise ? 20 : 100) * off;
  return turn >= least_turn && sagitta >= 200 * off &&
         restlessness(surface, shape, region.faces, judged_faces) >= noise_restlessness;
}

bool convincing(const Surface& surface, const Limits& limits, const Region& region) {
  const bool plane = region.shape.kind == PrimitiveKind::plane;
  const std::size_t enough = region.shape.kind == PrimitiveKind::cylinder ? 4 : 5;
  if (!plane && directions(surface, region.faces, enough) < enough) return false;
  const std::vector<PointId> points = points_of(surface, region.faces, judged_faces);
  if (plane && points.size() < 4 && !bounded_by_sharp_edges(surface, limits, region)) return false;
  if (!plane && points.size() < 8) return false;
  if (row_of_smooth_surface(surface, limits, region)) return false;
  const double negligible = limits.tolerance / 40;
  if (region.rms <= negligible) return true;
  if (region.rms > 0.45 * limits.tolerance) return false;
  if (points.size() < few_points) return region.rms <= limits.tolerance / 5;
  const Residuals r = residuals(surface, region.shape, points);
  const double restless = restlessness(surface, region.shape, region.faces, judged_faces);
  const double most = restless >= noise_restlessness ? 1 : largest_systematic;
  if (r.systematic > std::max(negligible, most * r.random)) return false;
  return restless >= least_restlessness || faceted(surface, region.faces, judged_faces);
}

}  // namespace deform::detection
