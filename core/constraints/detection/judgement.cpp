#include "core/constraints/detection/judgement.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace deform::detection {

namespace {

constexpr std::size_t fit_faces = 600;
constexpr std::size_t judged_faces = 2000;
constexpr int terms = 20;  ///< monomials in x, y, z up to degree 3
constexpr std::size_t few_points = 3 * terms;

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
  double systematic = 0;  ///< rms of what the polynomial explains, less what it would of noise
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
  std::erase_if(candidates, [&](const Candidate& c) { return c.distance > std::max(1.15 * least, limits.floor / 2); });
  if (candidates.empty()) return region;
  // Simple kinds first: a later one must be clearly closer in direction. A plane needs to be right in direction as well.
  std::sort(candidates.begin(), candidates.end(), [](const Candidate& a, const Candidate& b) { return a.shape.kind < b.shape.kind; });
  const Candidate* best = nullptr;
  for (const Candidate& c : candidates) {
    const double factor = c.shape.kind == PrimitiveKind::cone || (best && best->shape.kind == PrimitiveKind::plane) ? 0.8 : 1.0;
    if (!best || c.angle < factor * best->angle - 1e-6) best = &c;
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
  return r.systematic <= std::max(limits.tolerance / 20, r.random);
}

bool convincing(const Surface& surface, const Limits& limits, const Region& region) {
  const bool plane = region.shape.kind == PrimitiveKind::plane;
  const std::size_t enough = region.shape.kind == PrimitiveKind::cylinder ? 4 : 5;
  if (!plane && directions(surface, region.faces, enough) < enough) return false;
  const std::vector<PointId> points = points_of(surface, region.faces, judged_faces);
  if (plane && points.size() < 4 && !bounded_by_sharp_edges(surface, limits, region)) return false;
  if (!plane && points.size() < 8) return false;
  const double negligible = limits.tolerance / 20;
  if (region.rms <= negligible) return true;
  if (points.size() < few_points) return region.rms <= limits.tolerance / 5;
  const Residuals r = residuals(surface, region.shape, points);
  return r.systematic <= std::max(negligible, r.random);
}

}  // namespace deform::detection
