// SPDX-License-Identifier: Apache-2.0
#include "core/quality/element_quality.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/quality/infinity.h"
#include "core/quality/moving_cells.h"
#include "core/quality/quadratic_map.h"
#include "core/quality/summary.h"

namespace deform {

namespace {

constexpr std::size_t elements_per_range = 4096;

struct Measured {
  double scaled_jacobian = 0, volume = 0, edge_ratio = 0, aspect_ratio = 0;
  bool inverted = false;
};

// Sum of the cones from the first node to every face: triangles, or fans around the mean of four corners.
double volume(std::span<const Vec3> points, std::span<const PointId> nodes, const ElementShape& shape) {
  const Vec3& apex = points[nodes[0]];
  double six_times = 0;
  for (const auto& face : shape.faces) {
    Vec3 middle{};
    for (const auto corner : face) middle = middle + points[nodes[corner]];
    middle = (1.0 / static_cast<double>(face.size())) * middle;
    for (std::size_t c = 0; c < face.size(); ++c) {
      const Vec3 &p = points[nodes[face[c]]], &next = points[nodes[face[(c + 1) % face.size()]]];
      six_times += dot(p - apex, cross(next - apex, middle - apex));
    }
  }
  return six_times / 6;
}

double volume(std::span<const Vec3> points, std::span<const PointId> nodes, const QuadraticMap& map) {
  double sum = 0;
  for (const auto& point : map.quadrature()) {
    const auto columns = jacobian(points, nodes, point.gradients);
    sum += point.weight * dot(columns[0], cross(columns[1], columns[2]));
  }
  return sum;
}

struct Lengths {
  double least = infinity, largest = 0;
};

Lengths edge_lengths(std::span<const Vec3> points, std::span<const PointId> nodes, const ElementShape& shape) {
  Lengths result;
  for (std::size_t i = 0; i < shape.edges.size(); ++i) {
    const Vec3 &a = points[nodes[shape.edges[i][0]]], &b = points[nodes[shape.edges[i][1]]];
    double size = 0;
    if (shape.quadratic()) {
      const Vec3& mid = points[nodes[shape.corners + i]];
      size = length(a - mid) + length(mid - b);
    } else {
      size = length(a - b);
    }
    result.least = std::min(result.least, size);
    result.largest = std::max(result.largest, size);
  }
  return result;
}

/// k such that the height of the reference element over a face is k volume / area.
double height_factor(const ElementShape& shape, std::size_t face) {
  switch (shape.corners) {
    case 4:
      return 3;
    case 5:
      return face == 0 ? 3 : 1.5;
    case 6:
      return face < 2 ? 1 : 2;
    default:
      return 1;
  }
}

double least_height(std::span<const Vec3> points, std::span<const PointId> nodes, const ElementShape& shape, double volume) {
  double least = infinity;
  for (std::size_t f = 0; f < shape.faces.size(); ++f) {
    const auto& face = shape.faces[f];
    const Vec3& at = points[nodes[face[0]]];
    Vec3 twice{};
    for (std::size_t c = 1; c + 1 < face.size(); ++c) {
      twice = twice + cross(points[nodes[face[c]]] - at, points[nodes[face[c + 1]]] - at);
    }
    least = std::min(least, 2 * height_factor(shape, f) * volume / length(twice));
  }
  return least;
}

Measured measure(std::span<const Vec3> points, const Elements& elements, const quality::MovingCells& cells, std::size_t e) {
  const auto nodes = elements.nodes(e);
  const ElementShape& form = shape(elements.types[e]);
  Measured result;
  const auto state = cells.state(points, e);
  result.scaled_jacobian = state.determinant;
  result.inverted = state.inverted;
  result.volume = (cells.left_handed(e) ? -1 : 1) *
                  (form.quadratic() ? volume(points, nodes, QuadraticMap::of(elements.types[e])) : volume(points, nodes, form));
  const Lengths edges = edge_lengths(points, nodes, form);
  result.edge_ratio = edges.least > 0 ? edges.largest / edges.least : infinity;
  result.aspect_ratio = result.volume > 0 ? edges.largest / least_height(points, nodes, form, result.volume) : infinity;
  return result;
}

ElementMeasures none() {
  ElementMeasures result;
  result.least_scaled_jacobian.value = result.least_volume.value = result.least_edge_ratio.value = infinity;
  result.largest_volume.value = -infinity;
  return result;
}

/// Adds element e, one of `all`.
void add(const Measured& m, std::size_t e, std::size_t all, ElementMeasures& result) {
  ++result.elements;
  if (m.scaled_jacobian < result.least_scaled_jacobian.value) result.least_scaled_jacobian = {m.scaled_jacobian, e};
  result.average_scaled_jacobian += m.scaled_jacobian / static_cast<double>(all);
  if (m.volume < result.least_volume.value) result.least_volume = {m.volume, e};
  if (m.volume > result.largest_volume.value) result.largest_volume = {m.volume, e};
  result.total_volume += m.volume;
  if (m.edge_ratio < result.least_edge_ratio.value) result.least_edge_ratio = {m.edge_ratio, e};
  if (m.edge_ratio > result.largest_edge_ratio.value) result.largest_edge_ratio = {m.edge_ratio, e};
  if (m.aspect_ratio > result.largest_aspect_ratio.value) result.largest_aspect_ratio = {m.aspect_ratio, e};
  result.inverted_elements += m.inverted;
}

}  // namespace

ElementQuality element_quality(std::span<const Vec3> points, const Elements& elements, const RunContext& context) {
  return element_quality(points, elements, std::vector<char>{}, context);
}

ElementQuality element_quality(std::span<const Vec3> points, const Elements& elements, std::vector<char> left_handed,
                               const RunContext& context) {
  const std::size_t n = elements.size();
  if (n == 0) throw Error(ErrorCode::invalid_argument, "the mesh has no elements");
  const auto left = static_cast<std::size_t>(std::count(left_handed.begin(), left_handed.end(), 1));
  const auto cells = quality::moving_elements(elements, points.size());
  cells->take_as_left_handed(std::move(left_handed));
  std::vector<Measured> all(n);
  parallel_for(context, n, elements_per_range, [&](std::size_t begin, std::size_t end) {
    for (std::size_t e = begin; e < end; ++e) all[e] = measure(points, elements, *cells, e);
  });
  std::array<std::size_t, element_types> counts{};
  for (const ElementType type : elements.types) ++counts[static_cast<std::size_t>(type)];
  ElementQuality result;
  static_cast<ElementMeasures&>(result) = none();
  result.points = points.size();
  result.left_handed = left;
  for (std::size_t type = 0; type < element_types; ++type) {
    result.of_type[type] = counts[type] > 0 ? none() : ElementMeasures{};
  }
  for (std::size_t e = 0; e < n; ++e) {
    const Measured& m = all[e];
    const auto type = static_cast<std::size_t>(elements.types[e]);
    add(m, e, n, result);
    add(m, e, counts[type], result.of_type[type]);
    result.scaled_jacobian.push_back(m.scaled_jacobian);
    result.volume.push_back(m.volume);
    const double place = (std::clamp(m.scaled_jacobian, -1.0, 1.0) + 1) / 2 * ElementQuality::bins;
    ++result.histogram[std::min(ElementQuality::bins - 1, static_cast<std::size_t>(place))];
  }
  result.worst = quality::worst_of(n, [&](std::size_t e) { return all[e].scaled_jacobian; });
  return result;
}

}  // namespace deform
