// SPDX-License-Identifier: Apache-2.0
#include "core/quality/boundary_owners.h"

#include <algorithm>
#include <limits>
#include <string>
#include <unordered_map>

#include "core/base/error.h"

namespace deform {

namespace {

constexpr std::uint32_t no_owner = std::numeric_limits<std::uint32_t>::max();

struct KeyHash {
  std::size_t operator()(const std::vector<PointId>& key) const {
    std::uint64_t hash = 0xcbf29ce484222325;  // FNV-1a, by points
    for (const PointId p : key) hash = (hash ^ p) * 0x100000001b3;
    return static_cast<std::size_t>(hash ^ (hash >> 32));
  }
};

/// The faces of the surface that side `side` of an element becomes.
struct SideFaces {
  std::vector<PointId> nodes, points;
  std::vector<std::uint32_t> sizes;

  void assign(std::span<const PointId> element, const ElementShape& form, std::size_t side) {
    nodes.clear();
    points.clear();
    sizes.clear();
    for (const auto node : form.faces[side]) nodes.push_back(element[node]);
    if (const auto centre = form.face_centre(side); centre == ElementShape::no_node) {
      append_face(nodes, sizes, points);
    } else {
      append_face(nodes, element[centre], sizes, points);
    }
  }
};

}  // namespace

std::vector<BoundaryOwner> boundary_owners(const Mesh& boundary, const Elements& elements) {
  std::unordered_map<std::vector<PointId>, FaceId, KeyHash> ids;
  std::vector<char> outside(boundary.point_count());  // most sides of elements are internal, as their points show
  std::size_t corner = 0;
  for (std::size_t f = 0; f < boundary.face_count(); ++f) {
    const auto corners = std::span(boundary.face_points).subspan(corner, boundary.face_sizes[f]);
    for (const PointId p : corners) outside[p] = 1;
    ids.emplace(face_key(corners), static_cast<FaceId>(f));
    corner += corners.size();
  }
  std::vector<BoundaryOwner> owners(boundary.face_count(), {no_owner, 0});
  SideFaces faces;
  for (std::size_t e = 0; e < elements.size(); ++e) {
    const ElementShape& form = shape(elements.types[e]);
    const auto nodes = elements.nodes(e);
    for (std::size_t side = 0; side < form.faces.size(); ++side) {
      const auto& around = form.faces[side];
      if (!std::all_of(around.begin(), around.end(), [&](std::uint8_t node) { return outside[nodes[node]] != 0; })) continue;
      faces.assign(nodes, form, side);
      std::size_t first = 0;
      for (const std::uint32_t size : faces.sizes) {
        const auto found = ids.find(face_key(std::span(faces.points).subspan(first, size)));
        if (found != ids.end()) owners[found->second] = {static_cast<std::uint32_t>(e), static_cast<std::uint32_t>(side)};
        first += size;
      }
    }
  }
  for (std::size_t f = 0; f < owners.size(); ++f) {
    if (owners[f].cell != no_owner) continue;
    throw Error(ErrorCode::invalid_argument, "faces[" + std::to_string(f) + "]: it belongs to no element");
  }
  return owners;
}

std::vector<BoundaryOwner> boundary_owners(const Mesh& boundary, const PolyhedralCells& cells) {
  if (boundary.face_count() + cells.internal_faces() != cells.face_count()) {
    throw Error(ErrorCode::invalid_argument, "the boundary has " + std::to_string(boundary.face_count()) +
                                                 " faces, the cells have " +
                                                 std::to_string(cells.face_count() - cells.internal_faces()));
  }
  std::vector<BoundaryOwner> owners;
  owners.reserve(boundary.face_count());
  for (std::size_t f = cells.internal_faces(); f < cells.face_count(); ++f) {
    owners.push_back({cells.owner[f], static_cast<std::uint32_t>(f)});
  }
  return owners;
}

}  // namespace deform
