// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "core/io/assembly/element_mesh.h"

namespace deform::io {

/// Cells as VTK and SU2 store them: by VTK's type numbers, nodes in VTK's order.
struct VtkCells {
  static constexpr std::uint8_t polyhedron = 42;

  std::vector<std::uint8_t> types;
  std::vector<std::uint64_t> offsets{0};  ///< one more than types: nodes of cell i are points[offsets[i] .. offsets[i+1])
  /// Of a polyhedron its faces: their number, then for every face the number of its points and the points.
  std::vector<PointId> points;
  /// An integer per cell that names groups "LABEL_VALUE"; not used when its size is another.
  std::string label;
  std::vector<std::int64_t> labels;

  std::size_t size() const { return types.size(); }
  void add(std::uint8_t type, std::span<const PointId> nodes);
  /// An integer array of cell data. Only one names groups: the first one that is called as programs call the parts of a mesh,
  /// else the first one; none that has more than 256 different values, since it numbers cells.
  void offer_labels(const std::string& name, std::vector<std::int64_t> values);
};

/// Adds the cells to a mesh whose points are there already: volume cells as elements, surface cells as faces (strips as
/// triangles), lines and vertices with the points of their groups only. A mesh with polyhedra gets polyhedral cells instead of
/// elements. Programs disagree whether the base of a wedge is to be seen from inside or from outside: the order that makes more
/// volumes of the file positive is taken, VTK's own (from outside) when as many; likewise the faces of polyhedra. Throws
/// Error(invalid_argument) naming the file and the cell for unknown types, wrong numbers of nodes and nodes out of range.
void add_vtk_cells(const VtkCells& cells, const std::string& name, ElementMesh& mesh);

/// How VTK stores an element: the number of its type and, node by node in VTK's order, which of ours stands there. It has no
/// pyramid14: the mid-face node of the base is left out.
struct VtkElement {
  std::uint8_t type = 0;
  std::vector<std::uint8_t> nodes;
};
const VtkElement& vtk_element(ElementType type);

}  // namespace deform::io
