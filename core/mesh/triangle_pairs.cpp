// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/triangle_pairs.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "core/base/vectors.h"
#include "core/mesh/exact_signs.h"

namespace deform {

namespace {

using Corners = TriangleCorners;

/// The coordinate without which the triangle looks largest.
int flattest_axis(const Corners& t) {
  const Vec3 normal = cross(t[1] - t[0], t[2] - t[0]);
  int axis = 0;
  for (int k = 1; k < 3; ++k) {
    if (std::abs(normal[k]) > std::abs(normal[axis])) axis = k;
  }
  return axis;
}

/// For each corner whether the other triangle has it, too.
struct Shared {
  std::array<bool, 3> of_a{}, of_b{};
  int count = 0;
};

Shared shared_corners(const SurfaceTriangle& a, const SurfaceTriangle& b) {
  Shared shared;
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) {
      if (a.places[i] != b.places[j] || a.corners[i] != b.corners[j]) continue;
      shared.of_a[i] = shared.of_b[j] = true;
      ++shared.count;
    }
  }
  return shared;
}

/// Whether the corners of b that are not shared are clearly on one side of the plane of a.
bool clear_of_plane(const Corners& a, const Corners& b, const std::array<bool, 3>& shared_of_b) {
  int side = 0;
  for (std::size_t j = 0; j < 3; ++j) {
    if (shared_of_b[j]) continue;
    const int here = clear_side_of_plane(a[0], a[1], a[2], b[j]);
    if (here == 0 || here == -side) return false;
    side = here;
  }
  return true;
}

/// Whether the line of a side of a, seen along an axis, has the third corner of a clearly on one side and the corners of b that
/// are not on it by being shared clearly on the other one.
bool parted_by_side(const Corners& a, const Corners& b, const Shared& shared, bool swapped, int axis) {
  const auto& shared_of_a = swapped ? shared.of_b : shared.of_a;
  const auto& shared_of_b = swapped ? shared.of_a : shared.of_b;
  for (std::size_t i = 0; i < 3; ++i) {
    const Vec3 &p = a[i], &q = a[(i + 1) % 3];
    if (shared_of_a[(i + 2) % 3]) continue;
    const int own = clear_side_of_line(p, q, a[(i + 2) % 3], axis);
    if (own == 0) continue;
    bool parted = true;
    for (std::size_t j = 0; j < 3 && parted; ++j) {
      parted = shared_of_b[j] || clear_side_of_line(p, q, b[j], axis) == -own;
    }
    if (parted) return true;
  }
  return false;
}

bool segments_meet(const Vec3& p, const Vec3& q, const Vec3& r, const Vec3& s, int axis) {
  const int a = side_of_line(p, q, r, axis), b = side_of_line(p, q, s, axis);
  const int c = side_of_line(r, s, p, axis), d = side_of_line(r, s, q, axis);
  if (a * b > 0 || c * d > 0) return false;
  if (a != 0 || b != 0) return true;
  // On one line: by their extent.
  for (int k = 0; k < 3; ++k) {
    if (k == axis) continue;
    if (std::max(p[k], q[k]) < std::min(r[k], s[k]) || std::max(r[k], s[k]) < std::min(p[k], q[k])) return false;
  }
  return true;
}

bool inside(const Corners& t, const Vec3& p, int axis) {
  const int a = side_of_line(t[0], t[1], p, axis), b = side_of_line(t[1], t[2], p, axis), c = side_of_line(t[2], t[0], p, axis);
  return (a >= 0 && b >= 0 && c >= 0) || (a <= 0 && b <= 0 && c <= 0);
}

/// Exact.
bool segment_meets(const Vec3& p, const Vec3& q, const Corners& t) {
  const int of_p = side_of_plane(t[0], t[1], t[2], p), of_q = side_of_plane(t[0], t[1], t[2], q);
  if (of_p * of_q > 0) return false;
  if (of_p == 0 && of_q == 0) {
    const int axis = flattest_axis(t);
    if (inside(t, p, axis) || inside(t, q, axis)) return true;
    for (std::size_t i = 0; i < 3; ++i) {
      if (segments_meet(p, q, t[i], t[(i + 1) % 3], axis)) return true;
    }
    return false;
  }
  bool left = false, right = false;
  for (std::size_t i = 0; i < 3; ++i) {
    const int side = side_of_plane(p, q, t[i], t[(i + 1) % 3]);
    left = left || side > 0;
    right = right || side < 0;
  }
  return !(left && right);
}

/// Whether a side of a that is not ruled out meets b.
bool side_meets(const Corners& a, const std::array<bool, 3>& shared_of_a, const Corners& b) {
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t j = (i + 1) % 3;
    if (!shared_of_a[i] && !shared_of_a[j] && segment_meets(a[i], a[j], b)) return true;
  }
  return false;
}

/// Whether triangles with a common side are folded onto each other.
bool folded(const Corners& a, const Corners& b, const Shared& shared) {
  std::size_t apex_a = 0, apex_b = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    if (!shared.of_a[i]) apex_a = i;
    if (!shared.of_b[i]) apex_b = i;
  }
  const Vec3 &p = a[(apex_a + 1) % 3], &q = a[(apex_a + 2) % 3];
  const int axis = flattest_axis(a);
  if (clear_side_of_line(p, q, a[apex_a], axis) * clear_side_of_line(p, q, b[apex_b], axis) < 0) return false;
  return side_of_plane(a[0], a[1], a[2], b[apex_b]) == 0 &&
         side_of_line(p, q, a[apex_a], axis) == side_of_line(p, q, b[apex_b], axis);
}

}  // namespace

bool has_no_area(const TriangleCorners& corners) {
  for (int axis = 0; axis < 3; ++axis) {
    if (side_of_line(corners[0], corners[1], corners[2], axis) != 0) return false;
  }
  return true;
}

bool intersect(const SurfaceTriangle& a, const SurfaceTriangle& b) {
  const Shared shared = shared_corners(a, b);
  if (shared.count == 3) return true;
  if (clear_of_plane(a.corners, b.corners, shared.of_b)) return false;
  if (shared.count == 2) return folded(a.corners, b.corners, shared);
  if (clear_of_plane(b.corners, a.corners, shared.of_a)) return false;
  // This clears neighbours in a smooth surface.
  const int axis = flattest_axis(a.corners);
  if (parted_by_side(a.corners, b.corners, shared, false, axis) || parted_by_side(b.corners, a.corners, shared, true, axis)) {
    return false;
  }
  return side_meets(a.corners, shared.of_a, b.corners) || side_meets(b.corners, shared.of_b, a.corners);
}

}  // namespace deform
