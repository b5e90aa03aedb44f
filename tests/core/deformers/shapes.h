// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <string>

#include "core/base/types.h"
#include "core/deformers/setup.h"
#include "core/mesh/mesh.h"

namespace deform::test {

/// A height field over [0, 2] x [0, 1] as a grid of quads: columns x rows points, point (i, j) at i + columns * j.
inline Mesh bumpy_sheet(std::size_t columns, std::size_t rows) {
  Mesh mesh;
  for (std::size_t j = 0; j < rows; ++j) {
    for (std::size_t i = 0; i < columns; ++i) {
      const double x = 2.0 * static_cast<double>(i) / static_cast<double>(columns - 1);
      const double y = static_cast<double>(j) / static_cast<double>(rows - 1);
      mesh.points.push_back({x, y, 0.1 * std::sin(3 * x) * std::cos(2 * y)});
    }
  }
  for (std::size_t j = 0; j + 1 < rows; ++j) {
    for (std::size_t i = 0; i + 1 < columns; ++i) {
      const auto at = [&](std::size_t a, std::size_t b) { return static_cast<PointId>(a + columns * b); };
      mesh.face_sizes.push_back(4);
      for (const PointId id : {at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)}) mesh.face_points.push_back(id);
    }
  }
  return mesh;
}

inline Region box(const Vec3& min, const Vec3& max) { return {Region::InBox{min, max}}; }

/// The left end of the sheet stays, the right end is the handle "end".
inline Setup sheet_setup() {
  Setup setup;
  setup.handles = {{"end", box({1.7, -1, -1}, {3, 2, 1})}};
  setup.fixed = {box({-1, -1, -1}, {0.3, 2, 1})};
  return setup;
}

inline std::shared_ptr<const Mesh> shared(Mesh mesh) { return std::make_shared<const Mesh>(std::move(mesh)); }

inline double distance(const Vec3& a, const Vec3& b) { return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]); }

/// Largest distance between points of equal index; infinite when the counts differ.
inline double distance(const Points& a, const Points& b) {
  if (a.size() != b.size()) return HUGE_VAL;
  double largest = 0;
  for (std::size_t i = 0; i < a.size(); ++i) largest = std::max(largest, distance(a[i], b[i]));
  return largest;
}

/// Rotation about z by 0.3 with a translation.
inline Affine turn_and_shift() {
  const double c = std::cos(0.3), s = std::sin(0.3);
  return {c, -s, 0, 0.1, s, c, 0, -0.05, 0, 0, 1, 0.2};
}

}  // namespace deform::test
