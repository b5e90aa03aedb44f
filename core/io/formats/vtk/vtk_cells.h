// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "core/io/assembly/element_mesh.h"

namespace deform::io {

/// Type numbers of VTK, which SU2 uses too.
namespace vtk {
enum CellType : std::uint8_t {
  empty_cell = 0,
  vertex = 1,
  poly_vertex = 2,
  line = 3,
  poly_line = 4,
  triangle = 5,
  strip = 6,
  polygon = 7,
  quad = 9,
  tetrahedron = 10,
  hexahedron = 12,
  wedge = 13,
  pyramid = 14,
  quadratic_edge = 21,
  cubic_edge = 35,
  quadratic_polygon = 36
};
}  // namespace vtk

/// Cells as VTK and SU2 store them: by VTK's type numbers, nodes in VTK's order.
struct VtkCells {
  static constexpr std::uint8_t polyhedron = 42;

  std::vector<std::uint8_t> types;
  std::vector<std::uint64_t> offsets{0};  ///< types + 1: nodes of cell i are points[offsets[i] .. offsets[i+1])
  /// Nodes. For a polyhedron its faces: their number, then for each face the number of its points and the points.
  std::vector<PointId> points;
  /// The name of an integer array with one value per cell, which defines groups "LABEL_VALUE"; ignored if its size differs.
  std::string label;
  std::vector<std::int64_t> labels;

  std::size_t size() const { return types.size(); }
  void add(std::uint8_t type, std::span<const PointId> nodes);
  /// Offers an integer array of cell data. Only one array defines groups: the first with a name that programs use for the parts
  /// of a mesh, otherwise the first. Arrays with more than 256 distinct values are ignored, because they number cells.
  void offer_labels(const std::string& name, std::vector<std::int64_t> values);
};

/// Adds the cells to a mesh whose points are set: volume cells as elements, surface cells as faces (strips as triangles), lines
/// and vertices only as points of their groups. A mesh with polyhedra gets polyhedral cells instead of elements. Programs
/// disagree about the orientation of the base of a wedge: the order that makes more volumes of the file positive is used, that of
/// VTK (seen from outside) in case of a tie. The same holds for the faces of polyhedra. Throws Error(invalid_argument) naming the
/// file and the cell for unknown types, wrong numbers of nodes and nodes out of range.
void add_vtk_cells(const VtkCells& cells, const std::string& name, ElementMesh& mesh);

/// An element in VTK: the number of its type and, for each node in VTK's order, the node in the order of Elements. VTK has no
/// pyramid14; the mid-face node of its base is left out.
struct VtkElement {
  std::uint8_t type = 0;
  std::vector<std::uint8_t> nodes;
};
const VtkElement& vtk_element(ElementType type);

}  // namespace deform::io
