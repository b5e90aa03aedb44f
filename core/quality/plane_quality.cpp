// SPDX-License-Identifier: Apache-2.0
#include "core/quality/plane_quality.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/quality/moving_cells.h"
#include "core/quality/summary.h"

namespace deform {

namespace {

constexpr std::size_t plane_elements_per_range = 4096;

/// The interior angle at a corner, 0..2 pi; of a collapsed one 0.
double interior_angle(const Vec3& next, const Vec3& before) {
  const double angle = std::atan2(next[0] * before[1] - next[1] * before[0], next[0] * before[0] + next[1] * before[1]);
  return angle < 0 ? angle + 2 * std::numbers::pi : angle;
}

double skewness(std::span<const Vec3> points, std::span<const PointId> corners, bool clockwise) {
  const std::size_t n = corners.size();
  const double ideal = std::numbers::pi * (1 - 2 / static_cast<double>(n));
  double least = 2 * std::numbers::pi, largest = 0;
  for (std::size_t c = 0; c < n; ++c) {
    Vec3 next = points[corners[(c + 1) % n]] - points[corners[c]], before = points[corners[(c + n - 1) % n]] - points[corners[c]];
    if (clockwise) std::swap(next, before);
    const double angle = interior_angle(next, before);
    least = std::min(least, angle);
    largest = std::max(largest, angle);
  }
  return std::min(1.0, std::max((largest - ideal) / (std::numbers::pi - ideal), (ideal - least) / ideal));
}

}  // namespace

PlaneQuality plane_quality(std::span<const Vec3> points, const Mesh& mesh, std::vector<char> left_handed,
                           const RunContext& context) {
  const std::size_t n = mesh.face_count();
  if (n == 0) throw Error(ErrorCode::invalid_argument, "the mesh has no faces");
  PlaneQuality result;
  result.elements = n;
  result.left_handed = static_cast<std::size_t>(std::count(left_handed.begin(), left_handed.end(), 1));
  const auto cells = quality::moving_faces(mesh);
  cells->take_as_left_handed(std::move(left_handed));
  const auto offsets = mesh.face_offsets();
  std::vector<double> skew(n);
  std::vector<char> inverted(n);
  result.scaled_jacobian.resize(n);
  parallel_for(context, n, plane_elements_per_range, [&](std::size_t begin, std::size_t end) {
    for (std::size_t f = begin; f < end; ++f) {
      const auto state = cells->state(points, f);
      result.scaled_jacobian[f] = state.determinant;
      inverted[f] = state.inverted;
      skew[f] = skewness(points, std::span(mesh.face_points).subspan(offsets[f], mesh.face_sizes[f]), cells->left_handed(f));
    }
  });
  result.least_scaled_jacobian.value = std::numeric_limits<double>::infinity();
  for (std::size_t f = 0; f < n; ++f) {
    const double jacobian = result.scaled_jacobian[f];
    if (jacobian < result.least_scaled_jacobian.value) result.least_scaled_jacobian = {jacobian, f};
    if (skew[f] > result.largest_skewness.value) result.largest_skewness = {skew[f], f};
    result.average_scaled_jacobian += jacobian / static_cast<double>(n);
    result.average_skewness += skew[f] / static_cast<double>(n);
    result.inverted_elements += inverted[f] != 0;
  }
  result.worst = quality::worst_of(n, [&](std::size_t f) { return result.scaled_jacobian[f]; });
  return result;
}

}  // namespace deform
