// SPDX-License-Identifier: Apache-2.0
#include "core/io/assembly/element_mesh.h"

#include <map>
#include <set>

#include "core/base/error.h"
#include "core/io/assembly/face_groups.h"

namespace deform::io {

namespace {

void append(const ElementMesh::Face& face, Mesh& mesh) {
  if (face.centre) {
    append_face(face.corners, *face.centre, mesh.face_sizes, mesh.face_points);
  } else {
    append_face(face.corners, mesh.face_sizes, mesh.face_points);
  }
}

void add_face_sets(const ElementMesh& source, FaceGroups& groups, const std::function<void(std::size_t, std::size_t)>& add) {
  for (const auto& set : source.face_sets) {
    const std::size_t group = groups.find_or_add(set.kind, set.name);
    for (const std::size_t face : set.faces) add(face, group);
  }
}

void add_surface(const ElementMesh& source, Mesh& mesh, FaceGroups& groups, std::vector<std::int32_t>& entities) {
  std::vector<std::size_t> firsts;
  for (const auto& face : source.faces) {
    const std::size_t first = mesh.face_sizes.size();
    append(face, mesh);
    firsts.push_back(first);
    entities.resize(mesh.face_sizes.size(), face.entity);
    if (face.name.empty()) continue;
    const std::size_t group = groups.find_or_add(FaceGroups::Kind::group, face.name);
    for (std::size_t f = first; f < mesh.face_sizes.size(); ++f) groups.add_face(group, static_cast<FaceId>(f));
  }
  firsts.push_back(mesh.face_sizes.size());
  add_face_sets(source, groups, [&](std::size_t face, std::size_t group) {
    for (std::size_t f = firsts[face]; f < firsts[face + 1]; ++f) groups.add_face(group, static_cast<FaceId>(f));
  });
}

BoundaryFaces boundary_faces(const PolyhedralCells& cells) {
  BoundaryFaces boundary;
  for (std::size_t f = cells.internal_faces(); f < cells.face_count(); ++f) {
    append_face(cells.face(f), boundary.sizes, boundary.points);
    boundary.sides.push_back(static_cast<FaceId>(boundary.sizes.size()));
  }
  return boundary;
}

void add_boundary(const ElementMesh& source, Mesh& mesh, FaceGroups& groups, std::vector<std::int32_t>& entities) {
  BoundaryFaces boundary = source.cells ? boundary_faces(*source.cells) : boundary_faces(source.elements);
  std::map<std::vector<PointId>, std::size_t> sides;
  std::size_t corner = 0;
  for (std::size_t side = 0; side + 1 < boundary.sides.size(); ++side) {
    const std::size_t first = corner;
    for (FaceId f = boundary.sides[side]; f < boundary.sides[side + 1]; ++f) corner += boundary.sizes[f];
    sides.emplace(face_key(std::span(boundary.points).subspan(first, corner - first)), side);
  }
  const auto nodes_of = [&](std::size_t face) {
    std::vector<PointId> nodes = source.faces[face].corners;
    if (source.faces[face].centre) nodes.push_back(*source.faces[face].centre);
    return nodes;
  };
  entities.assign(boundary.sizes.size(), 0);
  for (std::size_t face = 0; face < source.faces.size(); ++face) {
    if (source.faces[face].entity == 0) continue;
    const auto found = sides.find(face_key(nodes_of(face)));
    if (found == sides.end()) continue;
    for (FaceId f = boundary.sides[found->second]; f < boundary.sides[found->second + 1]; ++f)
      entities[f] = source.faces[face].entity;
  }
  const auto add = [&](std::size_t face, std::size_t group) {
    const std::vector<PointId> nodes = nodes_of(face);
    if (const auto found = sides.find(face_key(nodes)); found != sides.end()) {
      for (FaceId f = boundary.sides[found->second]; f < boundary.sides[found->second + 1]; ++f) groups.add_face(group, f);
    } else {
      for (const PointId point : nodes) groups.add_point(group, point);
    }
  };
  for (std::size_t face = 0; face < source.faces.size(); ++face) {
    if (source.faces[face].name.empty()) continue;
    add(face, groups.find_or_add(FaceGroups::Kind::group, source.faces[face].name));
  }
  add_face_sets(source, groups, add);
  mesh.face_sizes = std::move(boundary.sizes);
  mesh.face_points = std::move(boundary.points);
}

void add_volumes(const ElementMesh& source, FaceGroups& groups) {
  if (std::set<std::string>(source.volume_names.begin(), source.volume_names.end()).size() < 2) return;
  for (std::size_t e = 0; e < source.elements.size(); ++e) {
    const std::size_t group = groups.find_or_add(FaceGroups::Kind::cell_zone, source.volume_names[e]);
    for (const PointId point : source.elements.nodes(e)) groups.add_point(group, point);
  }
}

void add_point_sets(const ElementMesh& source, FaceGroups& groups) {
  for (const auto& set : source.point_sets) {
    const std::size_t group = groups.find_or_add(set.kind, set.name);
    for (const PointId point : set.points) groups.add_point(group, point);
  }
}

}  // namespace

void ElementMesh::add_face(std::span<const PointId> nodes, const std::string& name) {
  Face face{{nodes.begin(), nodes.end()}, name};
  if (nodes.size() >= 6) {
    const std::size_t n = nodes.size() <= 7 ? 3 : 4;
    for (std::size_t c = 0; c < n; ++c) {
      face.corners[2 * c] = nodes[c];
      face.corners[2 * c + 1] = nodes[n + c];
    }
    face.corners.resize(2 * n);
    if (nodes.size() > 2 * n) face.centre = nodes[2 * n];
  }
  faces.push_back(std::move(face));
}

std::shared_ptr<const Mesh> mesh_of(ElementMesh&& source, const std::string& name, std::vector<std::int32_t>* entities) {
  auto mesh = std::make_shared<Mesh>();
  std::vector<std::int32_t> of_faces;
  try {
    FaceGroups groups;
    if (source.elements.size() == 0 && !source.cells) {
      add_surface(source, *mesh, groups, of_faces);
    } else {
      add_boundary(source, *mesh, groups, of_faces);
      add_volumes(source, groups);
    }
    add_point_sets(source, groups);
    mesh->groups = groups.finish();
    mesh->points = std::move(source.points);
    if (source.cells) {
      mesh->cells = std::make_shared<const PolyhedralCells>(std::move(*source.cells));
    } else if (source.elements.size() > 0) {
      mesh->elements = std::make_shared<const Elements>(std::move(source.elements));
    }
    mesh->validate();
  } catch (const Error& error) {
    throw Error(error.code(), name + ": " + error.what());
  }
  if (entities != nullptr) *entities = std::move(of_faces);
  return mesh;
}

}  // namespace deform::io
