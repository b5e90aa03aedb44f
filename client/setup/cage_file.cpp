// SPDX-License-Identifier: Apache-2.0
#include "client/setup/cage_file.h"

#include <string>

#include "client/setup/refuse.h"
#include "core/base/error.h"
#include "core/io/mesh_file.h"

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

}  // namespace

void read_cage(const std::filesystem::path& folder, v1::Setup& setup) {
  if (!setup.method().has_cage()) return;
  if (setup.method().cage().file().empty()) {
    if (setup.method().cage().vertices_size() > 0) return;
    refuse(
        "method.cage.file: missing, expected the cage, a mesh file of triangles beside the setup file; `deform cage mesh` makes "
        "one");
  }
  v1::CageMethod& cage = *setup.mutable_method()->mutable_cage();
  const std::filesystem::path path = folder / cage.file();
  try {
    if (cage.vertices_size() > 0 || cage.triangles_size() > 0) {
      refuse("vertices and triangles are given as well; remove one of the two");
    }
    take_mesh(*io::read_mesh_file(path)->mesh(), path.string(), cage);
  } catch (const Error& error) {
    throw Error(error.code(), std::string("method.cage.file: ") + error.what());
  }
  cage.clear_file();
}

}  // namespace deform::client
