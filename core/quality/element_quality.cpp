#include "core/quality/element_quality.h"

#include <algorithm>
#include <limits>
#include <numeric>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/quality/vectors.h"

namespace deform {

namespace {

using namespace quality;

constexpr std::size_t grain = 4096;
constexpr std::size_t most_listed = 100;

struct Measured {
  double scaled_jacobian = 0, volume = 0, edge_ratio = 0;
};

double scaled_jacobian(std::span<const Vec3> points, std::span<const PointId> nodes, const ElementShape& shape) {
  double least = std::numeric_limits<double>::infinity();
  for (const auto& corner : shape.corner_edges) {
    const Vec3& at = points[nodes[corner[0]]];
    const Vec3 a = points[nodes[corner[1]]] - at, b = points[nodes[corner[2]]] - at, c = points[nodes[corner[3]]] - at;
    const double lengths = length(a) * length(b) * length(c);
    least = std::min(least, lengths > 0 ? dot(a, cross(b, c)) / lengths : 0.0);
  }
  return least;
}

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

double edge_ratio(std::span<const Vec3> points, std::span<const PointId> nodes, const ElementShape& shape) {
  double least = std::numeric_limits<double>::infinity(), largest = 0;
  for (const auto& edge : shape.edges) {
    const double size = length(points[nodes[edge[0]]] - points[nodes[edge[1]]]);
    least = std::min(least, size);
    largest = std::max(largest, size);
  }
  return least > 0 ? largest / least : std::numeric_limits<double>::infinity();
}

Measured measure(std::span<const Vec3> points, const Elements& elements, std::size_t e) {
  const auto nodes = elements.nodes(e);
  for (const PointId p : nodes) {
    if (p >= points.size()) {
      throw Error(ErrorCode::invalid_argument, "elements[" + std::to_string(e) + "]: point " + std::to_string(p) +
                                                   " is out of range, there are " + std::to_string(points.size()));
    }
  }
  const ElementShape& form = shape(elements.types[e]);
  return {scaled_jacobian(points, nodes, form), volume(points, nodes, form), edge_ratio(points, nodes, form)};
}

}  // namespace

ElementQuality element_quality(std::span<const Vec3> points, const Elements& elements, const RunContext& context) {
  const std::size_t n = elements.size();
  if (n == 0) throw Error(ErrorCode::invalid_argument, "the mesh has no elements");
  std::vector<Measured> all(n);
  parallel_for(context, n, grain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t e = begin; e < end; ++e) all[e] = measure(points, elements, e);
  });
  constexpr double infinity = std::numeric_limits<double>::infinity();
  ElementQuality result;
  result.points = points.size();
  result.elements = n;
  result.least_scaled_jacobian.value = result.least_volume.value = infinity;
  result.largest_volume.value = -infinity;
  for (std::size_t e = 0; e < n; ++e) {
    const Measured& m = all[e];
    ++result.of_type[static_cast<std::size_t>(elements.types[e])];
    if (m.scaled_jacobian < result.least_scaled_jacobian.value) result.least_scaled_jacobian = {m.scaled_jacobian, e};
    result.average_scaled_jacobian += m.scaled_jacobian / static_cast<double>(n);
    if (m.volume < result.least_volume.value) result.least_volume = {m.volume, e};
    if (m.volume > result.largest_volume.value) result.largest_volume = {m.volume, e};
    result.total_volume += m.volume;
    if (m.edge_ratio > result.largest_edge_ratio.value) result.largest_edge_ratio = {m.edge_ratio, e};
    result.inverted_elements += m.scaled_jacobian <= 0;
    const double place = (std::clamp(m.scaled_jacobian, -1.0, 1.0) + 1) / 2 * ElementQuality::bins;
    ++result.histogram[std::min(ElementQuality::bins - 1, static_cast<std::size_t>(place))];
  }
  result.worst.resize(n);
  std::iota(result.worst.begin(), result.worst.end(), std::size_t{0});
  const auto listed = static_cast<std::ptrdiff_t>(std::min(n, most_listed));
  std::partial_sort(result.worst.begin(), result.worst.begin() + listed, result.worst.end(), [&](std::size_t a, std::size_t b) {
    return all[a].scaled_jacobian != all[b].scaled_jacobian ? all[a].scaled_jacobian < all[b].scaled_jacobian : a < b;
  });
  result.worst.resize(static_cast<std::size_t>(listed));
  return result;
}

}  // namespace deform
