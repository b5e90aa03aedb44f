#include "core/mesh/cells.h"

#include <string>

#include "core/base/error.h"

namespace deform {

namespace {

[[noreturn]] void refuse(const std::string& message) { throw Error(ErrorCode::invalid_argument, "cells: " + message); }

void check_size(const char* array, std::size_t size, std::size_t expected) {
  if (size != expected) {
    refuse(std::string(array) + ": has " + std::to_string(size) + " entries, expected " + std::to_string(expected));
  }
}

template <typename Ids>
void check_ids(const char* array, const Ids& ids, std::size_t limit, const char* noun) {
  for (std::size_t i = 0; i < ids.size(); ++i) {
    if (ids[i] < limit) continue;
    refuse(std::string(array) + "[" + std::to_string(i) + "]: " + noun + " " + std::to_string(ids[i]) +
           " is out of range, there are " + std::to_string(limit));
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
  check_ids("face_points", face_points, points, "point");
  check_ids("owner", owner, cell_count, "cell");
  check_ids("neighbour", neighbour, cell_count, "cell");
}

}  // namespace deform
