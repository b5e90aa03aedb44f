// SPDX-License-Identifier: Apache-2.0
#include "core/base/types.h"

#include <cmath>

namespace deform {

double Box::diagonal() const {
  if (min[0] > max[0]) return 0;
  double sum = 0;
  for (int k = 0; k < 3; ++k) sum += (max[k] - min[k]) * (max[k] - min[k]);
  return std::sqrt(sum);
}

int Box::longest_axis() const {
  int longest = 0;
  for (int k = 1; k < 3; ++k) {
    if (side(k) > side(longest)) longest = k;
  }
  return longest;
}

Box bounding_box(std::span<const Vec3> points) {
  Box box;
  for (const Vec3& p : points) box.add(p);
  return box;
}

Box bounding_box(std::span<const Vec3> points, std::span<const PointId> ids) {
  Box box;
  for (const PointId id : ids) box.add(points[id]);
  return box;
}

Affine compose(const Affine& a, const Affine& b) {
  Affine c{};
  for (int row = 0; row < 3; ++row) {
    for (int col = 0; col < 4; ++col) {
      double sum = col == 3 ? a[row * 4 + 3] : 0.0;
      for (int k = 0; k < 3; ++k) sum += a[row * 4 + k] * b[k * 4 + col];
      c[row * 4 + col] = sum;
    }
  }
  return c;
}

}  // namespace deform
