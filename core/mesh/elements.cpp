#include "core/mesh/elements.h"

#include <algorithm>
#include <numeric>

#include "core/base/error.h"

namespace deform {

namespace {

const ElementShape tetrahedron{"tetrahedron",
                               4,
                               {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}},
                               {{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}},
                               {{0, 1, 2, 3}, {1, 2, 0, 3}, {2, 0, 1, 3}, {3, 0, 2, 1}}};
const ElementShape pyramid{"pyramid",
                           5,
                           {{0, 3, 2, 1}, {0, 1, 4}, {1, 2, 4}, {2, 3, 4}, {3, 0, 4}},
                           {{0, 1}, {1, 2}, {2, 3}, {3, 0}, {0, 4}, {1, 4}, {2, 4}, {3, 4}},
                           {{0, 1, 3, 4}, {1, 2, 0, 4}, {2, 3, 1, 4}, {3, 0, 2, 4}}};
const ElementShape prism{"prism",
                         6,
                         {{0, 2, 1}, {3, 4, 5}, {0, 1, 4, 3}, {1, 2, 5, 4}, {2, 0, 3, 5}},
                         {{0, 1}, {1, 2}, {2, 0}, {3, 4}, {4, 5}, {5, 3}, {0, 3}, {1, 4}, {2, 5}},
                         {{0, 1, 2, 3}, {1, 2, 0, 4}, {2, 0, 1, 5}, {3, 5, 4, 0}, {4, 3, 5, 1}, {5, 4, 3, 2}}};
const ElementShape hexahedron{
    "hexahedron",
    8,
    {{0, 3, 2, 1}, {4, 5, 6, 7}, {0, 1, 5, 4}, {1, 2, 6, 5}, {2, 3, 7, 6}, {3, 0, 4, 7}},
    {{0, 1}, {1, 2}, {2, 3}, {3, 0}, {4, 5}, {5, 6}, {6, 7}, {7, 4}, {0, 4}, {1, 5}, {2, 6}, {3, 7}},
    {{0, 1, 3, 4}, {1, 2, 0, 5}, {2, 3, 1, 6}, {3, 0, 2, 7}, {4, 7, 5, 0}, {5, 4, 6, 1}, {6, 5, 7, 2}, {7, 6, 4, 3}}};

/// A face of an element, and where its key stands.
struct Side {
  std::uint32_t element;
  std::uint8_t face;
};

}  // namespace

const ElementShape& shape(ElementType type) {
  switch (type) {
    case ElementType::tetrahedron:
      return tetrahedron;
    case ElementType::pyramid:
      return pyramid;
    case ElementType::prism:
      return prism;
    case ElementType::hexahedron:
      break;
  }
  return hexahedron;
}

void Elements::add(ElementType type, std::span<const PointId> nodes) {
  types.push_back(type);
  points.insert(points.end(), nodes.begin(), nodes.end());
  offsets.push_back(points.size());
}

std::vector<PointId> face_key(std::span<const PointId> corners) {
  std::vector<PointId> key(corners.begin(), corners.end());
  std::sort(key.begin(), key.end());
  return key;
}

BoundaryFaces boundary_faces(const Elements& elements) {
  // Keys of at most four corners, padded; sorting them brings equal faces together.
  using Key = std::array<PointId, 4>;
  std::vector<std::pair<Key, Side>> sides;
  for (std::size_t e = 0; e < elements.size(); ++e) {
    const auto nodes = elements.nodes(e);
    const auto& faces = shape(elements.types[e]).faces;
    for (std::size_t f = 0; f < faces.size(); ++f) {
      Key key;
      key.fill(~PointId{0});
      for (std::size_t c = 0; c < faces[f].size(); ++c) key[c] = nodes[faces[f][c]];
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
  BoundaryFaces boundary;
  for (std::size_t i = 0; i < sides.size(); ++i) {
    if (!single[i]) continue;
    const Side side = sides[i].second;
    const auto nodes = elements.nodes(side.element);
    const auto& corners = shape(elements.types[side.element]).faces[side.face];
    boundary.sizes.push_back(static_cast<std::uint32_t>(corners.size()));
    for (const std::uint8_t corner : corners) boundary.points.push_back(nodes[corner]);
  }
  return boundary;
}

}  // namespace deform
