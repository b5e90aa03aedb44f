// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/types.h"

namespace deform {

/// Linear elements, then quadratic ones, named by their number of nodes.
enum class ElementType : std::uint8_t {
  tetrahedron,
  pyramid,
  prism,
  hexahedron,
  tetrahedron10,
  pyramid13,
  pyramid14,
  prism15,
  prism18,
  hexahedron20,
  hexahedron27
};
inline constexpr std::size_t element_types = 11;

/// The cells of a finite-element mesh, given by their nodes. Corners are in the order of Gmsh, CGNS and Medit: the Jacobian of a
/// valid element is positive, so its base (the first face) is counter-clockwise seen from inside. Nodes of quadratic elements are
/// in the order of CGNS (SIDS 3.3, TETRA_10 to HEXA_27), counted from 0: corners, mid-edge nodes, mid-face nodes, centre node.
///   tetrahedron10  4..9: edges 01 12 20 03 13 23
///   pyramid13      5..12: edges 01 12 23 30 04 14 24 34; pyramid14 also 13: base
///   prism15        6..14: edges 01 12 20 03 14 25 34 45 53; prism18 also 15..17: faces 0143 1254 2035
///   hexahedron20   8..19: edges 01 12 23 30 04 15 26 37 45 56 67 74; hexahedron27 also 20..25: faces 0321 0154 1265 2376 3047
///                  4567, and 26: centre
/// Immutable by convention once validated.
struct Elements {
  std::vector<ElementType> types;         ///< e
  std::vector<std::uint64_t> offsets{0};  ///< e + 1
  std::vector<PointId> points;            ///< nodes, element by element

  std::size_t size() const { return types.size(); }      ///< e
  std::span<const PointId> nodes(std::size_t i) const {  ///< nodes of element i
    return std::span(points).subspan(offsets[i], static_cast<std::size_t>(offsets[i + 1] - offsets[i]));
  }
  void add(ElementType type, std::span<const PointId> nodes);  ///< appends an element
  std::size_t bytes() const;                                   ///< memory of the arrays

  /// Throws Error(invalid_argument) naming the array, index and limit: no element, an unknown type, offsets that do not match the
  /// types, nodes out of range.
  void validate(std::size_t points) const;
};

/// The topology of an element type. Nodes are numbered within the element.
struct ElementShape {
  const char* name;     ///< of the type, as shown to users
  std::size_t nodes;    ///< number of nodes
  std::size_t corners;  ///< number of corners
  /// Nodes of each face, counter-clockwise seen from outside: the corners, with a mid-edge node after each one in
  /// quadratic elements.
  std::vector<std::vector<std::uint8_t>> faces;
  /// End points of the edges, each edge once. In quadratic elements node `corners` + i is the mid-edge node of edge i.
  std::vector<std::array<std::uint8_t, 2>> edges;
  /// A corner and its three neighbours, right-handed; there is no entry for the apex of a pyramid.
  std::vector<std::array<std::uint8_t, 4>> corner_edges;
  /// The mid-face node of each face, or no_node; empty if no face has one.
  std::vector<std::uint8_t> face_centres;

  static constexpr std::uint8_t no_node = 0xff;       ///< a face without a mid-face node
  bool quadratic() const { return nodes > corners; }  ///< whether edges have mid-edge nodes
  /// The mid-face node of a face, or no_node.
  std::uint8_t face_centre(std::size_t face) const { return face_centres.empty() ? no_node : face_centres[face]; }
};

const ElementShape& shape(ElementType type);

/// The faces that belong to exactly one element, oriented outwards, in the order of the elements, as the faces of a surface mesh.
/// In faces of quadratic elements the mid-edge nodes are corners too, and a face with a mid-face node becomes four quads around
/// it, so that every boundary node is the corner of a face. Faces are identified by their nodes. boundary_faces() throws
/// Error(invalid_argument) if a face belongs to more than two elements.
struct BoundaryFaces {
  std::vector<std::uint32_t> sizes;  ///< number of corners of each face
  std::vector<PointId> points;       ///< corners, face by face
  std::vector<FaceId> sides{0};      ///< side i of the boundary, a whole face of an element, is faces sides[i] .. sides[i+1]
};
BoundaryFaces boundary_faces(const Elements& elements);

/// Appends a face to those of a surface mesh: the polygon `around`, or with a mid-face node `centre` its around.size() / 2 quads
/// (corner, mid-edge, centre, mid-edge).
void append_face(std::span<const PointId> around, std::vector<std::uint32_t>& sizes, std::vector<PointId>& points);
void append_face(std::span<const PointId> around, PointId centre, std::vector<std::uint32_t>& sizes,
                 std::vector<PointId>& points);

/// A key that is the same for any order of the nodes of a face.
std::vector<PointId> face_key(std::span<const PointId> nodes);

}  // namespace deform
