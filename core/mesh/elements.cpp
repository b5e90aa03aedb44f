// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/elements.h"

#include <algorithm>
#include <numeric>

#include "core/base/checks.h"
#include "core/base/error.h"

namespace deform {

namespace {

/// A face of an element and the position of its key.
struct Side {
  std::uint32_t element;
  std::uint8_t face;
};

constexpr std::size_t most_nodes = 9;  // largest number of nodes of a face

/// The sides that belong to one element only. Keys of at most `width` nodes, padded; sorting them brings equal faces together.
template <std::size_t width>
std::vector<Side> single_sides(const Elements& elements) {
  using Key = std::array<PointId, width>;
  std::vector<std::pair<Key, Side>> sides;
  for (std::size_t e = 0; e < elements.size(); ++e) {
    const auto nodes = elements.nodes(e);
    const ElementShape& form = shape(elements.types[e]);
    for (std::size_t f = 0; f < form.faces.size(); ++f) {
      Key key;
      key.fill(~PointId{0});
      std::size_t used = 0;
      for (const std::uint8_t node : form.faces[f]) key[used++] = nodes[node];
      if (const std::uint8_t centre = form.face_centre(f); centre != ElementShape::no_node) key[used] = nodes[centre];
      std::sort(key.begin(), key.end());
      sides.push_back({key, {static_cast<std::uint32_t>(e), static_cast<std::uint8_t>(f)}});
    }
  }
  std::vector<std::uint32_t> order(sides.size());
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    return sides[a].first != sides[b].first ? sides[a].first < sides[b].first : a < b;
  });
  std::vector<char> single(sides.size());
  for (std::size_t i = 0; i < order.size();) {
    std::size_t end = i + 1;
    while (end < order.size() && sides[order[end]].first == sides[order[i]].first) ++end;
    if (end - i > 2) {
      throw Error(ErrorCode::invalid_argument, "elements[" + std::to_string(sides[order[i + 2]].second.element) + "]: face " +
                                                   std::to_string(sides[order[i + 2]].second.face) + " belongs to " +
                                                   std::to_string(end - i) + " elements, at most 2 can share one");
    }
    single[order[i]] = end - i == 1;
    i = end;
  }
  std::vector<Side> result;
  for (std::size_t i = 0; i < sides.size(); ++i) {
    if (single[i]) result.push_back(sides[i].second);
  }
  return result;
}

}  // namespace

void Elements::add(ElementType type, std::span<const PointId> nodes) {
  types.push_back(type);
  points.insert(points.end(), nodes.begin(), nodes.end());
  offsets.push_back(points.size());
}

std::vector<PointId> face_key(std::span<const PointId> nodes) {
  std::vector<PointId> key(nodes.begin(), nodes.end());
  std::sort(key.begin(), key.end());
  key.erase(std::unique(key.begin(), key.end()), key.end());
  return key;
}

void append_face(std::span<const PointId> around, std::vector<std::uint32_t>& sizes, std::vector<PointId>& points) {
  sizes.push_back(static_cast<std::uint32_t>(around.size()));
  points.insert(points.end(), around.begin(), around.end());
}

void append_face(std::span<const PointId> around, PointId centre, std::vector<std::uint32_t>& sizes,
                 std::vector<PointId>& points) {
  const std::size_t n = around.size();
  for (std::size_t corner = 0; corner < n; corner += 2) {
    const PointId quad[] = {around[corner], around[corner + 1], centre, around[(corner + n - 1) % n]};
    append_face(quad, sizes, points);
  }
}

BoundaryFaces boundary_faces(const Elements& elements) {
  const bool quadratic =
      std::any_of(elements.types.begin(), elements.types.end(), [](ElementType type) { return shape(type).quadratic(); });
  BoundaryFaces boundary;
  std::vector<PointId> around;
  for (const Side side : quadratic ? single_sides<most_nodes>(elements) : single_sides<4>(elements)) {
    const auto nodes = elements.nodes(side.element);
    const ElementShape& form = shape(elements.types[side.element]);
    around.clear();
    for (const std::uint8_t node : form.faces[side.face]) around.push_back(nodes[node]);
    if (const std::uint8_t centre = form.face_centre(side.face); centre == ElementShape::no_node) {
      append_face(around, boundary.sizes, boundary.points);
    } else {
      append_face(around, nodes[centre], boundary.sizes, boundary.points);
    }
    boundary.sides.push_back(static_cast<FaceId>(boundary.sizes.size()));
  }
  return boundary;
}

std::size_t Elements::bytes() const {
  return sizeof(Elements) + types.size() + offsets.size() * sizeof(offsets[0]) + points.size() * sizeof(PointId);
}

void Elements::validate(std::size_t point_count) const {
  const auto refuse = [](const std::string& message) { throw Error(ErrorCode::invalid_argument, "elements: " + message); };
  if (types.empty()) refuse("there must be at least one");
  if (offsets.size() != types.size() + 1 || offsets[0] != 0) refuse("offsets: expected 0 and one for each of the types");
  for (std::size_t e = 0; e < types.size(); ++e) {
    if (static_cast<std::size_t>(types[e]) >= element_types) {
      refuse("types[" + std::to_string(e) + "]: " + std::to_string(static_cast<int>(types[e])) + " is not a type, there are " +
             std::to_string(element_types));
    }
    if (offsets[e + 1] - offsets[e] != shape(types[e]).nodes) {
      refuse("offsets[" + std::to_string(e + 1) + "]: a " + shape(types[e]).name + " has " +
             std::to_string(shape(types[e]).nodes) + " nodes");
    }
  }
  if (offsets.back() != points.size()) {
    refuse("offsets: they end at " + std::to_string(offsets.back()) + ", there are " + std::to_string(points.size()) + " nodes");
  }
  check_ids(points, point_count, "elements: points", "point");
}

}  // namespace deform
