// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/gmsh/gmsh_elements.h"

#include <algorithm>
#include <utility>

namespace deform::io {

namespace {

// From Gmsh's edges and faces (reference manual, "Node ordering") to those of elements.h.
constexpr std::uint8_t tetrahedron10[] = {0, 1, 2, 3, 4, 5, 6, 7, 9, 8};
constexpr std::uint8_t pyramid14[] = {0, 1, 2, 3, 4, 5, 8, 10, 6, 7, 9, 11, 12, 13};
constexpr std::uint8_t prism18[] = {0, 1, 2, 3, 4, 5, 6, 9, 7, 8, 10, 11, 12, 14, 13, 15, 17, 16};
constexpr std::uint8_t hexahedron27[] = {0,  1,  2,  3,  4,  5,  6,  7,  8,  11, 13, 9,  10, 12,
                                         14, 15, 16, 18, 19, 17, 20, 21, 23, 24, 22, 25, 26};

constexpr ElementType none{};
constexpr GmshElementType types[] = {
    {1, 2, 1, none, nullptr},
    {2, 3, 2, none, nullptr},
    {3, 4, 2, none, nullptr},
    {4, 4, 3, ElementType::tetrahedron, nullptr},
    {5, 8, 3, ElementType::hexahedron, nullptr},
    {6, 6, 3, ElementType::prism, nullptr},
    {7, 5, 3, ElementType::pyramid, nullptr},
    {8, 3, 1, none, nullptr},
    {9, 6, 2, none, nullptr},
    {10, 9, 2, none, nullptr},
    {11, 10, 3, ElementType::tetrahedron10, tetrahedron10},
    {12, 27, 3, ElementType::hexahedron27, hexahedron27},
    {13, 18, 3, ElementType::prism18, prism18},
    {14, 14, 3, ElementType::pyramid14, pyramid14},
    {15, 1, 0, none, nullptr},
    {16, 8, 2, none, nullptr},
    {17, 20, 3, ElementType::hexahedron20, hexahedron27},
    {18, 15, 3, ElementType::prism15, prism18},
    {19, 13, 3, ElementType::pyramid13, pyramid14},
    {26, 4, 1, none, nullptr},
    {27, 5, 1, none, nullptr},
    {28, 6, 1, none, nullptr},
    {62, 7, 1, none, nullptr},
    {63, 8, 1, none, nullptr},
    {64, 9, 1, none, nullptr},
    {65, 10, 1, none, nullptr},
    {66, 11, 1, none, nullptr},
};

}  // namespace

const GmshElementType* gmsh_element_type(std::int64_t number) {
  for (const GmshElementType& type : types) {
    if (type.number == number) return &type;
  }
  return nullptr;
}

void GmshElements::name_group(int dimension, std::int64_t tag, const std::string& name) {
  if (!name.empty()) names_.insert_or_assign({dimension, std::abs(tag)}, name);
}

std::vector<std::size_t> GmshElements::groups_of(int dimension, std::span<const std::int64_t> tags) {
  std::vector<std::size_t> groups;
  for (const std::int64_t signed_tag : tags) {
    const std::int64_t tag = std::abs(signed_tag);
    if (tag == 0) continue;
    const auto [number, added] = numbers_.try_emplace({dimension, tag}, groups_.size());
    if (added) {
      const auto name = names_.find({dimension, tag});
      groups_.push_back(
          {dimension,
           name != names_.end() ? name->second : "physical_" + std::to_string(dimension) + "d_" + std::to_string(tag),
           {},
           {}});
    }
    groups.push_back(number->second);
  }
  return groups;
}

void GmshElements::join(std::size_t group, int dimension, std::span<const PointId> nodes) {
  if (dimension == 2) {
    groups_[group].faces.push_back(mesh_.faces.size() - 1);
  } else {
    groups_[group].points.insert(groups_[group].points.end(), nodes.begin(), nodes.end());
  }
}

void GmshElements::add(const GmshElementType& type, std::span<const PointId> nodes, std::span<const std::size_t> groups,
                       std::int64_t entity) {
  if (type.dimension == 2) {
    mesh_.add_face(nodes, "");
    if (std::in_range<std::int32_t>(entity)) mesh_.faces.back().entity = static_cast<std::int32_t>(entity);
  } else if (type.dimension == 3) {
    PointId ordered[27];
    for (std::size_t i = 0; i < type.nodes; ++i) ordered[i] = nodes[type.order == nullptr ? i : type.order[i]];
    mesh_.elements.add(type.volume, {ordered, type.nodes});
  }
  for (const std::size_t group : groups) join(group, type.dimension, nodes);
}

void GmshElements::add_or_repeat(const GmshElementType& type, std::span<const PointId> nodes, std::span<const std::size_t> groups,
                                 std::int64_t entity) {
  std::vector<PointId> key(nodes.begin(), nodes.end());
  std::sort(key.begin(), key.end());
  const auto known = [&](std::size_t group) {
    return std::find(last_groups_.begin(), last_groups_.end(), group) != last_groups_.end();
  };
  if (&type == last_type_ && key == last_ && !groups.empty() && !last_groups_.empty() &&
      std::none_of(groups.begin(), groups.end(), known)) {
    for (const std::size_t group : groups) join(group, type.dimension, nodes);
  } else {
    add(type, nodes, groups, entity);
    last_type_ = &type;
    last_ = std::move(key);
    last_groups_.clear();
  }
  last_groups_.insert(last_groups_.end(), groups.begin(), groups.end());
}

ElementMesh GmshElements::take(std::vector<Vec3>&& points) {
  mesh_.points = std::move(points);
  for (Group& group : groups_) {
    if (group.dimension == 2) {
      mesh_.face_sets.push_back({std::move(group.name), std::move(group.faces)});
    } else {
      const auto kind = group.dimension == 3 ? FaceGroups::Kind::cell_zone : FaceGroups::Kind::point_zone;
      mesh_.point_sets.push_back({std::move(group.name), std::move(group.points), kind});
    }
  }
  return std::move(mesh_);
}

}  // namespace deform::io
