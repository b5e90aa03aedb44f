// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/mesh/operators/shell_operators.h"

#include <cmath>
#include <cstdint>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/vectors.h"
#include "core/mesh/polygon_fan.h"

namespace deform {

namespace {

using Entry = Eigen::Triplet<double, std::int64_t>;

/// A unit vector at right angles to v, which is not zero.
Vec3 some_normal(const Vec3& v) {
  std::size_t least = 0;
  for (std::size_t k = 1; k < 3; ++k) {
    if (std::abs(v[k]) < std::abs(v[least])) least = k;
  }
  Vec3 axis{};
  axis[least] = 1;
  const Vec3 n = cross(v, axis);
  return n / norm(n);
}

/// The data of a triangle that the operators need.
struct Shape {
  Vec3 edge[3];        ///< opposite to each corner, around the triangle
  Vec3 normal{};       ///< unit length; arbitrary for a flat triangle
  double doubled = 0;  ///< twice the effective area; 0 if all corners coincide
  bool flat = false;
  bool stretched = false;  ///< see ShellOperators

  Shape(const Points& points, const Triangle& triangle, double scale) {
    double longest = 0;
    std::size_t at = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      const Vec3& a = points[triangle.corners[(i + 1) % 3]];
      const Vec3& b = points[triangle.corners[(i + 2) % 3]];
      edge[i] = (b - a) / scale;
      if (norm(edge[i]) > longest) {
        longest = norm(edge[i]);
        at = i;
      }
    }
    const Vec3 n = cross(edge[0], edge[1]);
    doubled = norm(n);
    const double least = ShellOperators::least_height * longest * longest;
    flat = doubled <= least;
    stretched = longest * longest > ShellOperators::stretched * doubled;
    if (doubled > 0) {
      normal = n / doubled;
    } else if (longest > 0) {
      normal = some_normal(edge[at]);
    }
    if (flat) doubled = least;
  }

  /// Cotangent of the angle at a corner.
  double cotangent(std::size_t corner) const { return -dot(edge[(corner + 1) % 3], edge[(corner + 2) % 3]) / doubled; }

  /// Shares of the corners in the area: Voronoi cells, cut off at the longest side of an obtuse triangle.
  void add_areas(const Triangle& triangle, Eigen::VectorXd& areas) const {
    for (std::size_t i = 0; i < 3; ++i) {
      double share = doubled / 6;
      if (!flat) {
        const double cotangents[3] = {cotangent(0), cotangent(1), cotangent(2)};
        const std::size_t j = (i + 1) % 3, k = (i + 2) % 3;
        if (cotangents[0] >= 0 && cotangents[1] >= 0 && cotangents[2] >= 0) {
          share = (dot(edge[j], edge[j]) * cotangents[j] + dot(edge[k], edge[k]) * cotangents[k]) / 8;
        } else {
          share = cotangents[i] < 0 ? doubled / 4 : doubled / 8;
        }
      }
      areas[triangle.corners[i]] += share;
    }
  }
};

void check_scale(double scale) {
  if (!(scale > 0 && std::isfinite(scale))) {
    throw Error(ErrorCode::invalid_argument, "shell operators: scale must be positive and finite, got " + number_digits(scale));
  }
}

}  // namespace

std::vector<Triangle> fan_triangles(const Mesh& mesh, const std::vector<char>& faces) {
  std::vector<Triangle> triangles;
  std::uint64_t first = 0;
  for (std::size_t f = 0; f < mesh.face_count(); ++f) {
    const PointId* corners = mesh.face_points.data() + first;
    first += mesh.face_sizes[f];
    if (!faces.empty() && faces[f] == 0) continue;
    const std::uint32_t m = mesh.face_sizes[f];
    const auto apex = static_cast<std::uint32_t>(fan_apex(mesh.points, {corners, m}));
    for (std::uint32_t i = 2; i < m; ++i) {
      const PointId a = corners[apex], b = corners[(apex + i - 1) % m], c = corners[(apex + i) % m];
      if (a != b && b != c && c != a) triangles.push_back({{a, b, c}, static_cast<FaceId>(f)});
    }
  }
  return triangles;
}

ShellOperators shell_operators(const Mesh& mesh, double scale, const std::vector<char>& faces, const RunContext& context) {
  check_scale(scale);
  const auto n = static_cast<std::int64_t>(mesh.point_count());
  const std::vector<Triangle> triangles = fan_triangles(mesh, faces);
  ShellOperators result;
  result.areas = Eigen::VectorXd::Zero(n);
  std::vector<Entry> entries;
  entries.reserve(12 * triangles.size());
  double area = 0;
  constexpr std::size_t triangles_per_check = 8192;
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    if (t % triangles_per_check == 0) context.check();
    const Triangle& triangle = triangles[t];
    const Shape shape(mesh.points, triangle, scale);
    if (shape.flat && result.flat_triangles++ == 0) result.first_flat = triangle.face;
    if (shape.doubled <= 0) continue;
    shape.add_areas(triangle, result.areas);
    area += shape.doubled;
    if (shape.stretched) result.stretched_area += shape.doubled;
    for (std::size_t i = 0; i < 3; ++i) {
      const std::int64_t a = triangle.corners[(i + 1) % 3], b = triangle.corners[(i + 2) % 3];
      const double weight = 0.5 * shape.cotangent(i);
      entries.emplace_back(a, b, weight);
      entries.emplace_back(b, a, weight);
      entries.emplace_back(a, a, -weight);
      entries.emplace_back(b, b, -weight);
    }
  }
  if (area > 0) result.stretched_area /= area;
  context.check();
  result.laplacian.resize(n, n);
  result.laplacian.setFromTriplets(entries.begin(), entries.end());
  return result;
}

SparseMatrix shell_gradient(const Mesh& mesh, double scale) {
  check_scale(scale);
  const std::vector<Triangle> triangles = fan_triangles(mesh);
  std::vector<Entry> entries;
  entries.reserve(9 * triangles.size());
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    const Shape shape(mesh.points, triangles[t], scale);
    if (shape.doubled <= 0) continue;
    // The gradient of the hat of a corner is normal x opposite edge / (2 area).
    const double weight = std::sqrt(0.5 * shape.doubled) / shape.doubled;
    for (std::size_t i = 0; i < 3; ++i) {
      const Vec3 g = cross(shape.normal, shape.edge[i]);
      for (std::size_t k = 0; k < 3; ++k) {
        entries.emplace_back(static_cast<std::int64_t>(3 * t + k), triangles[t].corners[i], weight * g[k]);
      }
    }
  }
  SparseMatrix G(static_cast<std::int64_t>(3 * triangles.size()), static_cast<std::int64_t>(mesh.point_count()));
  G.setFromTriplets(entries.begin(), entries.end());
  return G;
}

}  // namespace deform
