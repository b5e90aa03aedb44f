// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "core/mesh/elements.h"

namespace deform::io {

/// How the reader treats an element type of Abaqus.
struct AbaqusType {
  enum class Use {
    volume,       ///< an element of the mesh
    shell,        ///< a face: shells, membranes, rigid and surface elements
    plane,        ///< a face: the elements of two-dimensional and axisymmetric models, whose sides are edges
    other,        ///< ignored except for the points of sets: beams, springs, masses, ...
    unsupported,  ///< a solid whose node order the reader does not know
  };
  Use use = Use::other;
  std::size_t nodes = 0;  ///< 0: as many as on the data lines
  ElementType volume{};
  const std::uint8_t* order = nullptr;  ///< node i of `volume` is node order[i] of Abaqus; null: the same
};

/// Looks up an element type by its name in capitals.
AbaqusType abaqus_type(std::string_view name);

/// The face of shape(type) that Abaqus calls S<side>, counted from 1; std::nullopt if there is none.
std::optional<std::size_t> abaqus_side(ElementType type, std::int64_t side);

}  // namespace deform::io
