// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/methods/shapes.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <numbers>

#include "core/base/vectors.h"
#include "core/mesh/elements.h"

namespace deform::bench {

namespace {

/// Points by what they are made from, so that neighbours share them.
class SharedPoints {
 public:
  explicit SharedPoints(Points& points) : points_(points) {}
  PointId at(const std::array<std::int64_t, 3>& key, const Vec3& place) {
    const auto [entry, added] = ids_.emplace(key, static_cast<PointId>(points_.size()));
    if (added) points_.push_back(place);
    return entry->second;
  }

 private:
  Points& points_;
  std::map<std::array<std::int64_t, 3>, PointId> ids_;
};

void add_triangle(Mesh& mesh, PointId a, PointId b, PointId c) {
  mesh.face_sizes.push_back(3);
  mesh.face_points.insert(mesh.face_points.end(), {a, b, c});
}

}  // namespace

Mesh geodesic_sphere(double radius, std::uint32_t n) {
  const double g = std::numbers::phi;
  const std::array<Vec3, 12> corners{{{-1, g, 0},
                                      {1, g, 0},
                                      {-1, -g, 0},
                                      {1, -g, 0},
                                      {0, -1, g},
                                      {0, 1, g},
                                      {0, -1, -g},
                                      {0, 1, -g},
                                      {g, 0, -1},
                                      {g, 0, 1},
                                      {-g, 0, -1},
                                      {-g, 0, 1}}};
  const std::array<std::array<std::size_t, 3>, 20> faces{
      {{0, 11, 5}, {0, 5, 1}, {0, 1, 7}, {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
       {3, 9, 4},  {3, 4, 2}, {3, 2, 6}, {3, 6, 8},  {3, 8, 9},   {4, 9, 5}, {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}}};
  Mesh mesh;
  SharedPoints shared(mesh.points);
  for (const auto& face : faces) {
    const auto point = [&](std::uint32_t i, std::uint32_t j) {
      const std::uint32_t k = n - i - j;
      const Vec3 x = (static_cast<double>(k) / n) * corners[face[0]] + (static_cast<double>(i) / n) * corners[face[1]] +
                     (static_cast<double>(j) / n) * corners[face[2]];
      std::array<std::int64_t, 3> key;
      for (std::size_t axis = 0; axis < 3; ++axis) key[axis] = std::llround(1e9 * x[axis]);
      return shared.at(key, (radius / norm(x)) * x);
    };
    for (std::uint32_t i = 0; i < n; ++i) {
      for (std::uint32_t j = 0; i + j < n; ++j) {
        add_triangle(mesh, point(i, j), point(i + 1, j), point(i, j + 1));
        if (i + j + 1 < n) add_triangle(mesh, point(i + 1, j), point(i + 1, j + 1), point(i, j + 1));
      }
    }
  }
  return mesh;
}

Mesh plate(std::size_t nx, std::size_t ny, double width, double height) {
  Mesh mesh;
  for (std::size_t j = 0; j < ny; ++j) {
    for (std::size_t i = 0; i < nx; ++i) {
      mesh.points.push_back({width * static_cast<double>(i) / static_cast<double>(nx - 1),
                             height * static_cast<double>(j) / static_cast<double>(ny - 1), 0});
    }
  }
  for (std::size_t j = 0; j + 1 < ny; ++j) {
    for (std::size_t i = 0; i + 1 < nx; ++i) {
      const auto a = static_cast<PointId>(j * nx + i), b = a + 1, d = a + static_cast<PointId>(nx), c = d + 1;
      if ((i + j) % 2 == 0) {
        add_triangle(mesh, a, b, c);
        add_triangle(mesh, a, c, d);
      } else {
        add_triangle(mesh, a, b, d);
        add_triangle(mesh, b, c, d);
      }
    }
  }
  return mesh;
}

Pipe bent_pipe(std::size_t along, std::size_t around, std::size_t through) {
  Pipe pipe;
  const double pi = std::numbers::pi, bend = 3, inner = 0.5, outer = 1;
  const auto at = [&](std::size_t s, std::size_t a, std::size_t r) {
    return static_cast<PointId>((s * around + a % around) * (through + 1) + r);
  };
  /// Along the pipe by an angle, around its middle by another one, by the radius.
  const auto place = [&](double way, double angle, double radius, double turn) {
    const double from_axis = bend + radius * std::cos(angle), t = turn * way;
    return Vec3{from_axis * std::cos(t), from_axis * std::sin(t), radius * std::sin(angle)};
  };
  auto elements = std::make_shared<Elements>();
  for (std::size_t s = 0; s <= along; ++s) {
    for (std::size_t a = 0; a < around; ++a) {
      for (std::size_t r = 0; r <= through; ++r) {
        const double way = static_cast<double>(s) / static_cast<double>(along);
        const double angle = 2 * pi * static_cast<double>(a) / static_cast<double>(around);
        const double share = static_cast<double>(r) / static_cast<double>(through), radius = inner + (outer - inner) * share;
        pipe.mesh.points.push_back(place(way, angle, radius, pi / 2));
        if (s > 0 && s < along && r > 0 && r < through) continue;
        pipe.boundary.push_back(at(s, a, r));
        // Straightened by a third, its bore narrowed in the middle, its outside bulged.
        const double bump = std::sin(pi * way) * std::sin(pi * way), changed = radius + bump * (-0.2 + 0.5 * share);
        pipe.change.push_back(place(way, angle, changed, pi / 3) - pipe.mesh.points.back());
      }
    }
  }
  for (std::size_t s = 0; s < along; ++s) {
    for (std::size_t a = 0; a < around; ++a) {
      for (std::size_t r = 0; r < through; ++r) {
        const std::array<PointId, 8> nodes{at(s, a, r),     at(s, a + 1, r),     at(s, a + 1, r + 1),     at(s, a, r + 1),
                                           at(s + 1, a, r), at(s + 1, a + 1, r), at(s + 1, a + 1, r + 1), at(s + 1, a, r + 1)};
        elements->add(ElementType::hexahedron, nodes);
      }
    }
  }
  BoundaryFaces faces = boundary_faces(*elements);
  pipe.mesh.face_sizes = std::move(faces.sizes);
  pipe.mesh.face_points = std::move(faces.points);
  pipe.mesh.elements = std::move(elements);
  return pipe;
}

CageShape sphere_cage(double radius, std::uint32_t n) {
  Mesh mesh = geodesic_sphere(radius, n);
  CageShape cage;
  cage.vertices = std::move(mesh.points);
  for (std::size_t f = 0; f < mesh.face_sizes.size(); ++f) {
    cage.triangles.push_back({mesh.face_points[3 * f], mesh.face_points[3 * f + 1], mesh.face_points[3 * f + 2]});
  }
  return cage;
}

CageShape box_cage(const Vec3& min, const Vec3& max, const std::array<std::size_t, 3>& counts) {
  CageShape cage;
  SharedPoints shared(cage.vertices);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::size_t u = (axis + 1) % 3, v = (axis + 2) % 3;
    for (const bool upper : {false, true}) {
      const auto point = [&](std::size_t i, std::size_t j) {
        std::array<std::int64_t, 3> key{};
        key[axis] = upper ? static_cast<std::int64_t>(counts[axis]) : 0;
        key[u] = static_cast<std::int64_t>(i);
        key[v] = static_cast<std::int64_t>(j);
        Vec3 x{};
        for (std::size_t k = 0; k < 3; ++k) {
          x[k] = min[k] + (max[k] - min[k]) * static_cast<double>(key[k]) / static_cast<double>(counts[k]);
        }
        return shared.at(key, x);
      };
      for (std::size_t i = 0; i < counts[u]; ++i) {
        for (std::size_t j = 0; j < counts[v]; ++j) {
          const PointId a = point(i, j), b = point(i + 1, j), c = point(i + 1, j + 1), d = point(i, j + 1);
          if (upper) {
            cage.triangles.push_back({a, b, c});
            cage.triangles.push_back({a, c, d});
          } else {
            cage.triangles.push_back({a, c, b});
            cage.triangles.push_back({a, d, c});
          }
        }
      }
    }
  }
  return cage;
}

}  // namespace deform::bench
