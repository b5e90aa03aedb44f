// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/cells.h"

#include <string>

#include "core/base/checks.h"
#include "core/base/error.h"

namespace deform {

namespace {

[[noreturn]] void refuse(const std::string& message) { throw Error(ErrorCode::invalid_argument, "cells: " + message); }

void check_size(const char* array, std::size_t size, std::size_t expected) {
  if (size != expected) {
    refuse(std::string(array) + ": has " + std::to_string(size) + " entries, expected " + std::to_string(expected));
  }
}

}  // namespace

std::size_t PolyhedralCells::bytes() const {
  return sizeof(PolyhedralCells) + face_offsets.size() * sizeof(face_offsets[0]) +
         (face_points.size() + owner.size() + neighbour.size()) * sizeof(PointId) + empty_faces.size();
}

void PolyhedralCells::validate(std::size_t points) const {
  if (cell_count == 0) refuse("there must be at least one");
  if (face_offsets.empty() || face_offsets[0] != 0) refuse("face_offsets[0]: must be 0");
  for (std::size_t f = 0; f < face_count(); ++f) {
    if (face_offsets[f + 1] <= face_offsets[f]) refuse("face_offsets[" + std::to_string(f + 1) + "]: a face needs a corner");
  }
  if (face_offsets.back() != face_points.size()) {
    refuse("face_offsets: they end at " + std::to_string(face_offsets.back()) + ", face_points has " +
           std::to_string(face_points.size()));
  }
  check_size("owner", owner.size(), face_count());
  if (neighbour.size() > face_count()) refuse("neighbour: " + std::to_string(neighbour.size()) + ", more than faces");
  if (!empty_faces.empty()) check_size("empty_faces", empty_faces.size(), face_count());
  check_ids(face_points, points, "cells: face_points", "point");
  check_ids(owner, cell_count, "cells: owner", "cell");
  check_ids(neighbour, cell_count, "cells: neighbour", "cell");
}

}  // namespace deform
