// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/mesh/elements.h"

namespace deform::io {

/// The elements of a block of an Exodus file (Sjaardema, EXODUS: A Finite Element Data Model, 2023, chapter 4).
struct ExodusForm {
  enum class Kind { points, edge, face, cell };
  Kind kind;
  ElementType type = ElementType::tetrahedron;  ///< of cells
};

/// From `elem_type` in any case, of which digits and what follows the first three letters do not matter, and the number of nodes.
/// None when there is no such element here.
std::optional<ExodusForm> exodus_form(const std::string& elem_type, std::size_t nodes);

/// From the order of nodes of Exodus to that of CGNS, see Elements: they differ in the last seven of 27 only.
void exodus_to_cgns(ElementType type, std::span<PointId> nodes);

/// The face of our shape that is side `side` (from 1) of a cell; none when it has not that many.
std::optional<std::size_t> exodus_cell_side(ElementType type, std::int64_t side);

/// The nodes of edge `edge` (from 0) of a surface element of 3 to 9 nodes, with its mid-edge node where it has one.
std::vector<PointId> exodus_face_edge(std::span<const PointId> nodes, std::size_t edge);

}  // namespace deform::io
