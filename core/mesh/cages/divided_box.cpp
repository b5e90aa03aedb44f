// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/cages/divided_box.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "core/mesh/cages/cage_around.h"

namespace deform {

namespace {

using Counts = std::array<std::size_t, 3>;

constexpr double flattest_right_angle = 3.5;  // ratio of the sides of a rectangle, whose triangles have 15.9 degrees

std::size_t points_of(const Counts& n) { return 2 * (n[0] * n[1] + n[1] * n[2] + n[2] * n[0]) + 2; }

double flatness(const Counts& n, const Vec3& sides) {
  double least = std::numeric_limits<double>::infinity(), most = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    least = std::min(least, sides[k] / static_cast<double>(n[k]));
    most = std::max(most, sides[k] / static_cast<double>(n[k]));
  }
  return most / least;
}

}  // namespace

SquarestDivisions squarest_divisions(const Vec3& sides, std::size_t points, const std::array<bool, 3>& mirrored) {
  const auto wanted = static_cast<double>(points);
  SquarestDivisions best;
  const auto step = [&](std::size_t axis) -> std::size_t { return mirrored[axis] ? 2 : 1; };
  // One division more than half of the points would be a bar of four points around.
  const std::size_t most = points / 2 + 8;
  for (std::size_t i = step(0); i <= most; i += step(0)) {
    for (std::size_t j = step(1); i * j <= most; j += step(1)) {
      // The only number of divisions along the third axis that gives the count, and those beside it.
      const double exact = (wanted / 2 - 1 - static_cast<double>(i * j)) / static_cast<double>(i + j);
      const auto third = static_cast<double>(step(2));
      const auto middle = static_cast<std::size_t>(std::max(1.0, std::round(exact / third)));
      for (std::size_t k = std::max<std::size_t>(2, middle) - 1; k <= middle + 1; ++k) {
        const Counts n{i, j, k * step(2)};
        const double flat = flatness(n, sides);
        if (flat > flattest_right_angle) continue;
        const std::size_t count = points_of(n);
        if (count <= points) best.below = std::max(best.below, count);
        if (count >= points) best.above = best.above == 0 ? count : std::min(best.above, count);
        if (std::abs(static_cast<double>(count) - wanted) > CageRequest::count_tolerance * wanted) continue;
        if (flat >= best.flatness) continue;
        best.divisions = BoxDivisions{n, mirrored};
        best.flatness = flat;
      }
    }
  }
  return best;
}

Mesh divided_box(const Box& box, const BoxDivisions& divisions) {
  const Counts& n = divisions.counts;
  Mesh mesh;
  std::map<Counts, PointId> numbers;
  const auto number = [&](const Counts& at) {
    const auto [found, added] = numbers.try_emplace(at, static_cast<PointId>(mesh.points.size()));
    if (added) {
      Vec3& x = mesh.points.emplace_back();
      for (std::size_t k = 0; k < 3; ++k) {
        const double part = static_cast<double>(at[k]) / static_cast<double>(n[k]);
        x[k] = (1 - part) * box.min[k] + part * box.max[k];
      }
    }
    return found->second;
  };
  const auto is_image = [&](std::size_t axis, std::size_t at) { return divisions.mirrored[axis] && 2 * at >= n[axis]; };
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t a = (k + 1) % 3, b = (k + 2) % 3;
    for (const bool far : {false, true}) {
      for (std::size_t j = 0; j < n[b]; ++j) {
        for (std::size_t i = 0; i < n[a]; ++i) {
          const auto corner = [&](std::size_t di, std::size_t dj) {
            Counts at{};
            at[k] = far ? n[k] : 0;
            at[a] = i + di;
            at[b] = j + dj;
            return number(at);
          };
          std::array<PointId, 4> around{corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)};
          if (!far) std::swap(around[1], around[3]);
          // The diagonal goes from the first to the third.
          if (is_image(a, i) != is_image(b, j)) std::rotate(around.begin(), around.begin() + 1, around.end());
          mesh.face_sizes.insert(mesh.face_sizes.end(), 2, 3);
          for (const std::size_t c : {0, 1, 2, 0, 2, 3}) mesh.face_points.push_back(around[c]);
        }
      }
    }
  }
  return mesh;
}

}  // namespace deform
