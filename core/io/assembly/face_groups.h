// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "core/mesh/mesh.h"

namespace deform::io {

/// Collects named groups while a file is read. A repeated name of the same kind continues its group.
class FaceGroups {
 public:
  enum class Kind { group, object, material, patch_group, point_zone, face_zone, cell_zone, family, section };
  static constexpr int kinds = 9;

  /// The number of a group for add_face() and add_point(). Names are converted to UTF-8 without control characters; names that
  /// are not valid UTF-8 are taken as Latin-1.
  std::size_t find_or_add(Kind kind, std::string_view original);
  void add_face(std::size_t group, FaceId face) { entries_[group].members.faces.push_back(face); }
  void add_point(std::size_t group, PointId point) { entries_[group].members.points.push_back(point); }

  /// The groups with members, in order of first appearance, with unique names. If the name of a group is taken by a group of
  /// another kind with different members, it is called "object:NAME", "material:NAME", "patchGroup:NAME", "pointZone:NAME",
  /// "faceZone:NAME", "cellZone:NAME", "family:NAME" or "section:NAME"; with the same members it is omitted.
  std::vector<Group> finish();

 private:
  struct Entry {
    Kind kind;
    Group members;
  };
  std::vector<Entry> entries_;
  std::unordered_map<std::string, std::size_t> index_[kinds];  // by kind
};

}  // namespace deform::io
