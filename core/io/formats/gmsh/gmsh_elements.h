// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "core/io/assembly/element_mesh.h"

namespace deform::io {

/// An element type of Gmsh by its number.
struct GmshElementType {
  int number;
  std::size_t nodes;
  int dimension;
  ElementType volume;         ///< type for dimension 3
  const std::uint8_t* order;  ///< for dimension 3: node i of `volume` is node order[i] of Gmsh; null: the same
};
/// Returns nullptr for types that are unknown or of an order above two. Lines of any order are known, because only their
/// points matter.
const GmshElementType* gmsh_element_type(std::int64_t number);

/// Collects elements and physical groups. Groups of surfaces contain faces, all others points.
class GmshElements {
 public:
  /// Names the physical group `tag` of a dimension. The sign of a tag is only an orientation.
  void name_group(int dimension, std::int64_t tag, const std::string& name);
  /// The numbers of the groups for add(); groups without a name get one. Tag 0 means no group.
  std::vector<std::size_t> groups_of(int dimension, std::span<const std::int64_t> tags);

  /// entity: the tag of the geometrical entity on which it lies, 0: none.
  void add(const GmshElementType& type, std::span<const PointId> nodes, std::span<const std::size_t> groups, std::int64_t entity);
  /// The same for version 2, which repeats an element for each of its groups.
  void add_or_repeat(const GmshElementType& type, std::span<const PointId> nodes, std::span<const std::size_t> groups,
                     std::int64_t entity);

  ElementMesh take(std::vector<Vec3>&& points);

 private:
  struct Group {
    int dimension;
    std::string name;
    std::vector<PointId> points;
    std::vector<std::size_t> faces;
  };
  void join(std::size_t group, int dimension, std::span<const PointId> nodes);

  std::map<std::pair<int, std::int64_t>, std::string> names_;
  std::map<std::pair<int, std::int64_t>, std::size_t> numbers_;
  std::vector<Group> groups_;
  ElementMesh mesh_;
  const GmshElementType* last_type_ = nullptr;  // of the element before
  std::vector<PointId> last_;                   // its nodes, sorted
  std::vector<std::size_t> last_groups_;        // its groups so far
};

}  // namespace deform::io
