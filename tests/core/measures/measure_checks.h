// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "core/base/vectors.h"
#include "core/measures/measure.h"
#include "core/mesh/mesh.h"

namespace deform::test {

inline double dot_all(const Points& a, const Points& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += dot(a[i], b[i]);
  return sum;
}

/// Points moved by independent normal deviates of this size.
inline Points shaken(const Points& points, double size, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal(0, size);
  Points moved = points;
  for (Vec3& p : moved) p = p + Vec3{normal(random), normal(random), normal(random)};
  return moved;
}

/// A motion of waves as long as the mesh, of about this size.
inline Points waves(const Points& points, double size, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal(0, 1);
  const Box box = bounding_box(points);
  const double diagonal = box.diagonal();
  std::array<Vec3, 3> ways, directions;
  for (std::size_t k = 0; k < 3; ++k) {
    ways[k] = {3 * normal(random), 3 * normal(random), 3 * normal(random)};
    directions[k] = {normal(random), normal(random), normal(random)};
  }
  Points moved;
  for (const Vec3& p : points) {
    Vec3 sum{};
    for (std::size_t k = 0; k < 3; ++k)
      sum = sum + std::sin(dot(ways[k], p - box.min) / diagonal + static_cast<double>(k)) * directions[k];
    moved.push_back(size * sum);
  }
  return moved;
}

inline Points plus(const Points& points, double step, const Points& direction) {
  Points moved;
  for (std::size_t i = 0; i < points.size(); ++i) moved.push_back(points[i] + step * direction[i]);
  return moved;
}

/// Compares the gradient of each value with central differences of fourth order along random directions: of single points and of
/// waves. `tolerance` is relative to the change of the value if all parts of the gradient pointed along the direction.
inline void expect_gradient(const measures::Measure& measure, const Points& points, double tolerance,
                            double relative_step = 1e-5) {
  const double step = relative_step * bounding_box(points).diagonal();
  const measures::Measurement found = measure.evaluate(points, measures::Gradients::wanted);
  ASSERT_EQ(found.values.size(), measure.value_count());
  ASSERT_EQ(found.gradients.size(), measure.value_count());
  const Points still(points.size(), Vec3{});
  for (unsigned seed = 1; seed <= 4; ++seed) {
    const Points direction = seed % 2 == 0 ? waves(points, 1, seed) : shaken(still, 1, seed);
    const auto at = [&](double t) {
      return measure.evaluate(plus(points, t * step, direction), measures::Gradients::left_out).values;
    };
    const auto far_up = at(1), up = at(0.5), down = at(-0.5), far_down = at(-1);
    for (std::size_t k = 0; k < found.values.size(); ++k) {
      const double slope = (8 * (up[k] - down[k]) - (far_up[k] - far_down[k])) / (6 * step);
      double size = 0;
      for (std::size_t i = 0; i < points.size(); ++i) size += length(found.gradients[k][i]) * length(direction[i]);
      EXPECT_NEAR(dot_all(found.gradients[k], direction), slope, tolerance * size) << "value " << k << ", direction " << seed;
      EXPECT_GT(size, 0);
    }
  }
}

/// The same bits for any number of threads, and with and without gradients.
inline void expect_same_bits(const measures::Measure& measure, const Points& points) {
  RunContext one, many;
  one.threads = 1;
  const auto first = measure.evaluate(points, measures::Gradients::wanted, one),
             second = measure.evaluate(points, measures::Gradients::wanted, many);
  EXPECT_EQ(first.values, second.values);
  EXPECT_EQ(first.gradients, second.gradients);
  EXPECT_EQ(first.values, measure.evaluate(points, measures::Gradients::left_out, many).values);
}

/// Triangles of a mesh with a point of its own for each corner, as files of STL have them.
inline Mesh torn(const Mesh& mesh) {
  Mesh result;
  result.face_sizes = mesh.face_sizes;
  for (const PointId corner : mesh.face_points) {
    result.face_points.push_back(static_cast<PointId>(result.points.size()));
    result.points.push_back(mesh.points[corner]);
  }
  return result;
}

/// A block with `cells` quads along each edge, as six sheets that share their points: {x, y, z}; outward normals.
inline Mesh block(const Vec3& size, std::uint32_t cells) {
  Mesh mesh;
  const std::uint32_t n = cells + 1;
  std::vector<PointId> ids(static_cast<std::size_t>(n) * n * n, ~PointId{0});
  const auto point = [&](std::uint32_t i, std::uint32_t j, std::uint32_t k) {
    PointId& id = ids[(static_cast<std::size_t>(k) * n + j) * n + i];
    if (id == ~PointId{0}) {
      id = static_cast<PointId>(mesh.points.size());
      mesh.points.push_back({size[0] * i / cells, size[1] * j / cells, size[2] * k / cells});
    }
    return id;
  };
  for (std::uint32_t axis = 0; axis < 3; ++axis) {
    for (const std::uint32_t side : {0U, cells}) {
      for (std::uint32_t u = 0; u < cells; ++u) {
        for (std::uint32_t v = 0; v < cells; ++v) {
          const auto corner = [&](std::uint32_t s, std::uint32_t t) {
            std::array<std::uint32_t, 3> at{};
            at[axis] = side;
            at[(axis + 1) % 3] = s;
            at[(axis + 2) % 3] = t;
            return point(at[0], at[1], at[2]);
          };
          std::array<PointId, 4> corners{corner(u, v), corner(u + 1, v), corner(u + 1, v + 1), corner(u, v + 1)};
          if (side == 0) std::swap(corners[1], corners[3]);
          mesh.face_sizes.push_back(4);
          mesh.face_points.insert(mesh.face_points.end(), corners.begin(), corners.end());
        }
      }
    }
  }
  return mesh;
}

}  // namespace deform::test
