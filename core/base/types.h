// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace deform {

using Vec3 = std::array<double, 3>;

/// n points, n x 3, row by row, contiguous. Model units.
using Points = std::vector<Vec3>;

using PointId = std::uint32_t;
using FaceId = std::uint32_t;

/// Axis-aligned box. It is empty (min > max) until a point is added.
struct Box {
  Vec3 min{1e300, 1e300, 1e300};     ///< least coordinates
  Vec3 max{-1e300, -1e300, -1e300};  ///< greatest coordinates

  /// Enlarges the box so that it holds the point.
  void add(const Vec3& p) {
    for (int k = 0; k < 3; ++k) {
      if (p[k] < min[k]) min[k] = p[k];
      if (p[k] > max[k]) max[k] = p[k];
    }
  }
  double side(int axis) const { return max[axis] - min[axis]; }  ///< length of the side along an axis
  /// The axis of the longest side; of several, the first.
  int longest_axis() const;
  /// Length of the diagonal, 0 for an empty box. Tolerances are fractions of it, written D.
  double diagonal() const;
};

Box bounding_box(std::span<const Vec3> points);
/// The bounding box of the points with these ids.
Box bounding_box(std::span<const Vec3> points, std::span<const PointId> ids);

/// x' = A x + b as a 3 x 4 matrix [A b], row-major. Model units.
using Affine = std::array<double, 12>;
inline constexpr Affine identity_affine{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

inline Vec3 transformed(const Affine& m, const Vec3& p) {
  return {m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3], m[4] * p[0] + m[5] * p[1] + m[6] * p[2] + m[7],
          m[8] * p[0] + m[9] * p[1] + m[10] * p[2] + m[11]};
}

/// The composition a after b: x -> a(b(x)).
Affine compose(const Affine& a, const Affine& b);

}  // namespace deform
