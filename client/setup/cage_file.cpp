// SPDX-License-Identifier: Apache-2.0
#include "client/setup/cage_file.h"

#include <string>

#include "client/setup/refuse.h"
#include "core/base/error.h"
#include "core/io/mesh_file.h"
#include "core/mesh/cages/cage_around.h"

namespace deform::client {

namespace {

constexpr std::size_t most_points = 10000;

void take_mesh(const Mesh& mesh, const std::string& name, v1::CageMethod& cage) {
  if (mesh.point_count() > most_points) {
    refuse(name + ": has " + std::to_string(mesh.point_count()) + " points, a cage takes at most " + std::to_string(most_points));
  }
  for (std::size_t f = 0; f < mesh.face_count(); ++f) {
    if (mesh.face_sizes[f] == 3) continue;
    refuse(name + ": face " + std::to_string(f) + " has " + std::to_string(mesh.face_sizes[f]) +
           " corners; the faces of a cage are triangles");
  }
  cage.mutable_vertices()->Reserve(static_cast<int>(3 * mesh.point_count()));
  for (const Vec3& x : mesh.points) cage.mutable_vertices()->Add(x.begin(), x.end());
  cage.mutable_triangles()->Add(mesh.face_points.begin(), mesh.face_points.end());
}

CageRequest cage_request(const v1::CageMethod::Generate& message) {
  CageRequest request;
  switch (message.kind()) {
    case v1::BOX:
      request.kind = CageKind::box;
      break;
    case v1::HULL:
      request.kind = CageKind::hull;
      break;
    default:
      break;
  }
  if (message.points() != 0) request.points = message.points();
  request.offset = message.offset();
  return request;
}

}  // namespace

void fill_cage(const std::filesystem::path& folder, const std::string& field, const MeshSource& mesh, v1::Method& method) {
  if (!method.has_cage()) return;
  v1::CageMethod& cage = *method.mutable_cage();
  const bool file = !cage.file().empty(), given = cage.vertices_size() > 0 || cage.triangles_size() > 0;
  if (!file && !cage.has_generate()) {
    if (cage.vertices_size() > 0) return;
    refuse(field +
           ".file: missing, expected the cage, a mesh file of triangles beside the setup file; or let one be made with "
           "generate: {points: 400}, as `deform cage mesh` does");
  }
  const std::string source = field + (file ? ".file" : ".generate");
  try {
    if (file && cage.has_generate()) refuse("generate is given as well; remove one of the two");
    if (given) refuse("vertices and triangles are given as well; remove one of the two");
    if (file) {
      const std::filesystem::path path = folder / cage.file();
      take_mesh(*io::read_mesh_file(path)->mesh(), path.string(), cage);
    } else {
      take_mesh(cage_around(*mesh(), cage_request(cage.generate())).mesh, "the cage", cage);
    }
  } catch (const Error& error) {
    throw Error(error.code(), source + ": " + error.what());
  }
  cage.clear_file();
  cage.clear_generate();
}

}  // namespace deform::client
