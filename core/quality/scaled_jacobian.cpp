// SPDX-License-Identifier: Apache-2.0
#include "core/quality/scaled_jacobian.h"

#include <algorithm>
#include <limits>

#include "core/base/vectors.h"
#include "core/quality/infinity.h"
#include "core/quality/quadratic_map.h"

namespace deform {

namespace {

double scaled_determinant(const Vec3& a, const Vec3& b, const Vec3& c) {
  const double lengths = length(a) * length(b) * length(c);
  return lengths > 0 ? dot(a, cross(b, c)) / lengths : 0.0;
}

double at_corners(std::span<const Vec3> points, std::span<const PointId> nodes, const ElementShape& shape, double sign) {
  double least = infinity;
  for (const auto& corner : shape.corner_edges) {
    const Vec3& at = points[nodes[corner[0]]];
    const Vec3 a = points[nodes[corner[1]]] - at, b = points[nodes[corner[2]]] - at, c = points[nodes[corner[3]]] - at;
    least = std::min(least, sign * scaled_determinant(a, b, c));
  }
  return least;
}

double at_nodes(std::span<const Vec3> points, std::span<const PointId> nodes, const QuadraticMap& map, double sign) {
  double least = infinity;
  for (const auto& sample : map.samples()) {
    const auto columns = jacobian(points, nodes, sample.gradients);
    const auto along = [&](const Vec3& d) { return d[0] * columns[0] + d[1] * columns[1] + d[2] * columns[2]; };
    for (const auto& frame : sample.frames) {
      least = std::min(least, sign * scaled_determinant(along(frame[0]), along(frame[1]), along(frame[2])));
    }
  }
  return least;
}

}  // namespace

double scaled_jacobian(std::span<const Vec3> points, std::span<const PointId> nodes, ElementType type, Handedness handedness) {
  const ElementShape& form = shape(type);
  const double sign = handedness == Handedness::left ? -1 : 1;
  return form.quadratic() ? at_nodes(points, nodes, QuadraticMap::of(type), sign) : at_corners(points, nodes, form, sign);
}

}  // namespace deform
