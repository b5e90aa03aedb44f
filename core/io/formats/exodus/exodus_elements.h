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
  ElementType type = ElementType::tetrahedron;  ///< type of cells
};

/// The form for `elem_type` (in any case; only its first three letters count) and the number of nodes; std::nullopt if it is
/// not supported.
std::optional<ExodusForm> exodus_form(const std::string& elem_type, std::size_t nodes);

/// Converts nodes from the order of Exodus to that of CGNS (see Elements). They differ only in the last seven of 27.
void exodus_to_cgns(ElementType type, std::span<PointId> nodes);

/// The face of shape(type) that is side `side` (from 1) of a cell; std::nullopt if there is none.
std::optional<std::size_t> exodus_cell_side(ElementType type, std::int64_t side);

/// The nodes of edge `edge` (from 0) of a surface element of 3 to 9 nodes, with its mid-edge node, if any.
std::vector<PointId> exodus_face_edge(std::span<const PointId> nodes, std::size_t edge);

}  // namespace deform::io
