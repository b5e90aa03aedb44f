#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/types.h"

namespace deform {

enum class ElementType : std::uint8_t { tetrahedron, pyramid, prism, hexahedron };

/// The cells of a finite-element mesh by their nodes, in the order of Gmsh, CGNS and Medit: the Jacobian of a good element is
/// positive, so the base (first face) seen from inside goes counter-clockwise. Immutable by convention once validated.
struct Elements {
  std::vector<ElementType> types;
  std::vector<std::uint64_t> offsets{0};  ///< e + 1
  std::vector<PointId> points;

  std::size_t size() const { return types.size(); }
  std::span<const PointId> nodes(std::size_t i) const {
    return std::span(points).subspan(offsets[i], static_cast<std::size_t>(offsets[i + 1] - offsets[i]));
  }
  void add(ElementType type, std::span<const PointId> nodes);
};

/// What an element of a type looks like; node numbers within the element.
struct ElementShape {
  const char* name;
  std::size_t nodes;
  std::vector<std::vector<std::uint8_t>> faces;    ///< corners, counter-clockwise from outside
  std::vector<std::array<std::uint8_t, 2>> edges;  ///< each once
  std::vector<std::array<std::uint8_t, 4>>
      corner_edges;  ///< a corner and its three neighbours, right-handed; of a pyramid's apex none
};

const ElementShape& shape(ElementType type);

/// The faces that belong to one element only, outward, in the order of the elements: face sizes and corners of a surface mesh.
/// Throws Error(invalid_argument) when a face belongs to more than two.
struct BoundaryFaces {
  std::vector<std::uint32_t> sizes;
  std::vector<PointId> points;
};
BoundaryFaces boundary_faces(const Elements& elements);

/// Identifies a face by its corners in any order.
std::vector<PointId> face_key(std::span<const PointId> corners);

}  // namespace deform
