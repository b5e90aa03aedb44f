// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <numbers>
#include <string>
#include <vector>

#include "core/constraints/detection/detect.h"
#include "core/mesh/mesh.h"

namespace deform::test {

/// What a face of a part lies on. Kind none: on something that is no primitive (a torus).
struct Truth {
  enum class Kind { plane, cylinder, sphere, cone, none } kind = Kind::plane;
  double size = 0;  ///< radius of cylinder and sphere, half angle of a cone (radians)
};

/// A triangle mesh that knows what every face lies on. Points at the same place are one.
class Part {
 public:
  std::string name;
  Mesh mesh;
  std::vector<int> labels;  ///< per face: index into truths
  std::vector<Truth> truths;

  int truth(Truth::Kind kind, double size = 0) {
    truths.push_back({kind, size});
    return static_cast<int>(truths.size()) - 1;
  }

  PointId point(const Vec3& p) {
    std::array<long, 3> key{};
    for (std::size_t k = 0; k < 3; ++k) key[k] = std::lround(p[k] * 1e8);
    const auto [place, added] = ids_.try_emplace(key, static_cast<PointId>(mesh.points.size()));
    if (added) mesh.points.push_back(p);
    return place->second;
  }

  void triangle(int label, PointId a, PointId b, PointId c) {
    if (a == b || b == c || a == c) return;
    mesh.face_sizes.push_back(3);
    mesh.face_points.insert(mesh.face_points.end(), {a, b, c});
    labels.push_back(label);
  }

  /// columns x rows pairs of triangles at place(i, j), counter-clockwise in the plane of (i, j).
  void sheet(int label, int columns, int rows, const std::function<Vec3(int, int)>& place) {
    for (int j = 0; j < rows; ++j) {
      for (int i = 0; i < columns; ++i) {
        const PointId a = point(place(i, j)), b = point(place(i + 1, j)), c = point(place(i + 1, j + 1)),
                      d = point(place(i, j + 1));
        if ((i + j) % 2 == 0) {
          triangle(label, a, b, c);
          triangle(label, a, c, d);
        } else {
          triangle(label, a, b, d);
          triangle(label, b, c, d);
        }
      }
    }
  }

  /// The curve (radius, z) from 0 to 1 turned around the z axis.
  void revolve(int label, int around, int along, const std::function<std::array<double, 2>(double)>& curve) {
    sheet(label, around, along, [&](int i, int j) -> Vec3 {
      const auto [r, z] = curve(static_cast<double>(j) / along);
      const double angle = 2 * std::numbers::pi * (i % around) / around;
      return {r * std::cos(angle), r * std::sin(angle), z};
    });
  }

  /// From (r0, z0) to (r1, z1), straight.
  void revolve_line(int label, int around, int along, double r0, double z0, double r1, double z1) {
    revolve(label, around, along, [=](double t) -> std::array<double, 2> { return {r0 + t * (r1 - r0), z0 + t * (z1 - z0)}; });
  }

 private:
  std::map<std::array<long, 3>, PointId> ids_;
};

using Kind = Truth::Kind;

inline Part cube(int n) {
  Part part;
  part.name = "cube";
  for (int side = 0; side < 6; ++side) {
    const int label = part.truth(Kind::plane), axis = side / 2;
    const double level = side % 2;
    part.sheet(label, n, n, [&](int i, int j) {
      const double u = static_cast<double>(i) / n, v = static_cast<double>(j) / n;
      Vec3 p{};
      p[static_cast<std::size_t>(axis)] = level;
      p[static_cast<std::size_t>((axis + 1) % 3)] = side % 2 == 1 ? u : v;
      p[static_cast<std::size_t>((axis + 2) % 3)] = side % 2 == 1 ? v : u;
      return p;
    });
  }
  return part;
}

/// A point on the outline of the square of half width 1, counter-clockwise from (1, -1); t in 0..1.
inline std::array<double, 2> on_square(double t) {
  const double s = 4 * t, u = 2 * (s - std::floor(s)) - 1;
  switch (static_cast<int>(std::floor(s)) % 4) {
    case 0:
      return {1, u};
    case 1:
      return {-u, 1};
    case 2:
      return {-1, -u};
    default:
      return {u, -1};
  }
}

/// The plane at height z between the circle of that radius and the square of half width 1; seen from above or from below.
inline void pierced_square(Part& part, int label, int around, int rings, double radius, double z, int up) {
  part.sheet(label, around, rings, [&](int i, int j) -> Vec3 {
    const int k = up > 0 ? (i % around) : (around - i) % around;
    const double t = static_cast<double>(j) / rings, share = static_cast<double>(k) / around;
    const double angle = 2 * std::numbers::pi * share - std::numbers::pi / 4;
    const auto [x, y] = on_square(share);
    // From outside inwards.
    return {(1 - t) * x + t * radius * std::cos(angle), (1 - t) * y + t * radius * std::sin(angle), z};
  });
}

inline void square_sides(Part& part, int around, int rows, double low, double high) {
  for (int side = 0; side < 4; ++side) {
    const int label = part.truth(Kind::plane);
    part.sheet(label, around / 4, rows, [&](int i, int j) -> Vec3 {
      const auto [x, y] = on_square(static_cast<double>((side * (around / 4) + i) % around) / around);
      return {x, y, low + (high - low) * j / rows};
    });
  }
}

inline Part plate_with_hole(int n) {
  Part part;
  part.name = "plate_with_hole";
  const int around = 16 * n;
  const double z = 0.3;
  pierced_square(part, part.truth(Kind::plane), around, 2 * n, 0.5, z, 1);
  pierced_square(part, part.truth(Kind::plane), around, 2 * n, 0.5, -z, -1);
  square_sides(part, around, n, -z, z);
  part.sheet(part.truth(Kind::cylinder, 0.5), around, 2 * n, [&](int i, int j) -> Vec3 {
    const double angle = -2 * std::numbers::pi * (i % around) / around - std::numbers::pi / 4;
    return {0.5 * std::cos(angle), 0.5 * std::sin(angle), -z + 2 * z * j / (2 * n)};
  });
  return part;
}

inline Part capped_cylinder(int n) {
  Part part;
  part.name = "capped_cylinder";
  part.revolve_line(part.truth(Kind::plane), 16 * n, 2 * n, 0, 0, 0.6, 0);
  part.revolve_line(part.truth(Kind::cylinder, 0.6), 16 * n, n == 1 ? 1 : 4 * n, 0.6, 0, 0.6, 1.5);
  part.revolve_line(part.truth(Kind::plane), 16 * n, 2 * n, 0.6, 1.5, 0, 1.5);
  return part;
}

/// A dome of radius 0.7 that meets the top of a block at 60 degrees.
inline Part dome(int n) {
  Part part;
  part.name = "dome";
  const double radius = 0.7, start = std::numbers::pi / 3, foot = radius * std::sin(start);
  const int around = 16 * n;
  pierced_square(part, part.truth(Kind::plane), around, 2 * n, foot, 0, 1);
  const int label = part.truth(Kind::sphere, radius);
  part.sheet(label, around, 4 * n, [&](int i, int j) -> Vec3 {
    const double polar = start * (1 - static_cast<double>(j) / (4 * n));
    const double angle = 2 * std::numbers::pi * (i % around) / around - std::numbers::pi / 4;
    return {radius * std::sin(polar) * std::cos(angle), radius * std::sin(polar) * std::sin(angle),
            radius * (std::cos(polar) - std::cos(start))};
  });
  square_sides(part, around, n, -0.5, 0);
  // The bottom: a square without a hole.
  part.sheet(part.truth(Kind::plane), around, 2 * n, [&](int i, int j) -> Vec3 {
    const auto [x, y] = on_square(static_cast<double>((around - i) % around) / around);
    const double t = 1 - static_cast<double>(j) / (2 * n);
    return {t * x, t * y, -0.5};
  });
  return part;
}

inline Part frustum(int n) {
  Part part;
  part.name = "frustum";
  part.revolve_line(part.truth(Kind::plane), 16 * n, 2 * n, 0, 0, 0.8, 0);
  part.revolve_line(part.truth(Kind::cone, std::atan2(0.5, 1.0)), 16 * n, n == 1 ? 1 : 4 * n, 0.8, 0, 0.3, 1);
  part.revolve_line(part.truth(Kind::plane), 16 * n, n, 0.3, 1, 0, 1);
  return part;
}

inline Part step_shaft(int n) {
  Part part;
  part.name = "step_shaft";
  const int around = 20 * n;
  part.revolve_line(part.truth(Kind::plane), around, 2 * n, 0, 0, 0.3, 0);
  part.revolve_line(part.truth(Kind::cylinder, 0.3), around, 2 * n, 0.3, 0, 0.3, 0.6);
  part.revolve_line(part.truth(Kind::plane), around, n, 0.3, 0.6, 0.5, 0.6);
  part.revolve_line(part.truth(Kind::cylinder, 0.5), around, 2 * n, 0.5, 0.6, 0.5, 1.2);
  part.revolve_line(part.truth(Kind::plane), around, n, 0.5, 1.2, 0.3, 1.2);
  part.revolve_line(part.truth(Kind::cylinder, 0.3), around, 2 * n, 0.3, 1.2, 0.3, 1.8);
  part.revolve_line(part.truth(Kind::plane), around, 2 * n, 0.3, 1.8, 0, 1.8);
  return part;
}

/// A shaft that runs into a disc by a fillet: tangential joints on both sides of a torus.
inline Part filleted_shaft(int n) {
  Part part;
  part.name = "filleted_shaft";
  const int around = 24 * n;
  const double fillet = 0.2, shaft = 0.3, disc = 0.9;
  part.revolve_line(part.truth(Kind::plane), around, 2 * n, 0, -0.2, disc, -0.2);
  part.revolve_line(part.truth(Kind::cylinder, disc), around, n, disc, -0.2, disc, 0);
  part.revolve_line(part.truth(Kind::plane), around, 2 * n, disc, 0, shaft + fillet, 0);
  part.revolve(part.truth(Kind::none), around, 4 * n, [=](double t) -> std::array<double, 2> {
    const double angle = t * std::numbers::pi / 2;
    return {shaft + fillet - fillet * std::sin(angle), fillet - fillet * std::cos(angle)};
  });
  part.revolve_line(part.truth(Kind::cylinder, shaft), around, 3 * n, shaft, fillet, shaft, 1);
  part.revolve_line(part.truth(Kind::plane), around, n, shaft, 1, 0, 1);
  return part;
}

inline Part torus(int n) {
  Part part;
  part.name = "torus";
  part.revolve(part.truth(Kind::none), 32 * n, 16 * n, [](double t) -> std::array<double, 2> {
    const double angle = 2 * std::numbers::pi * t;
    return {1 + 0.35 * std::cos(angle), 0.35 * std::sin(angle)};
  });
  return part;
}

/// A block with rounded vertical edges: four planes that run into four quarter cylinders.
inline Part rounded_block(int n) {
  Part part;
  part.name = "rounded_block";
  const double half = 0.7, round = 0.3, height = 1;
  const int arc = 6 * n, straight = 4 * n, quarter = arc + straight, around = 4 * quarter;
  const auto outline = [&](int i) -> std::array<double, 2> {
    i %= around;
    const int q = i / quarter, k = i % quarter;
    double x = half + round, y = -half + 2 * half * k / straight;
    if (k > straight) {
      const double angle = std::numbers::pi / 2 * (k - straight) / arc;
      x = half + round * std::cos(angle);
      y = half + round * std::sin(angle);
    }
    for (int turn = 0; turn < q; ++turn) {
      const double old = x;
      x = -y;
      y = old;
    }
    return {x, y};
  };
  for (int q = 0; q < 4; ++q) {
    const auto side = [&](int first, int i, int j) -> Vec3 {
      const auto [x, y] = outline(q * quarter + first + i);
      return {x, y, height * j / (4 * n)};
    };
    part.sheet(part.truth(Kind::plane), straight, 4 * n, [&](int i, int j) { return side(0, i, j); });
    part.sheet(part.truth(Kind::cylinder, round), arc, 4 * n, [&](int i, int j) { return side(straight, i, j); });
  }
  for (const int up : {0, 1}) {
    part.sheet(part.truth(Kind::plane), around, 4 * n, [&](int i, int j) -> Vec3 {
      const auto [x, y] = outline(up == 1 ? i : 2 * around - i);
      const double t = 1 - static_cast<double>(j) / (4 * n);
      return {t * x, t * y, up * height};
    });
  }
  return part;
}

inline std::vector<Part> all_parts(int n) {
  std::vector<Part> parts;
  for (const auto& make :
       {cube, plate_with_hole, capped_cylinder, dome, frustum, step_shaft, filleted_shaft, rounded_block, torus}) {
    parts.push_back(make(n));
  }
  return parts;
}

}  // namespace deform::test
