// SPDX-License-Identifier: Apache-2.0
#include "client/setup/cage_file.h"

#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "client/setup/mirror_planes.h"
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

CageRequest cage_request(const v1::CageMethod& cage) {
  const v1::CageMethod::Generate& message = cage.generate();
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
  if (message.has_symmetry_tolerance()) {
    request.symmetry_tolerance = message.symmetry_tolerance();
  } else if (cage.control() != v1::MESH) {
    // Handles select vertices by numbers, which another cage would give to others.
    request.symmetry_tolerance = 0;
  }
  return request;
}

/// Lets the box of a half model end in its planes.
void end_in_planes(const std::vector<std::optional<MirrorPlane>>& planes, const Mesh& mesh, CageRequest& request) {
  const Box box = bounding_box(mesh.points);
  for (std::size_t i = 0; i < planes.size(); ++i) {
    std::size_t axis = 0;
    while (axis < 3 && std::abs(planes[i]->normal[axis]) < 1 - 1e-12) ++axis;
    if (axis == 3) {
      refuse("a box does not end in symmetry[" + std::to_string(i) +
             "], which is not perpendicular to an axis; use kind WRAP or HULL, which are their own mirror images in any plane");
    }
    const double at = planes[i]->point[axis];
    const bool above = box.max[axis] - at > at - box.min[axis];
    (above ? request.lowest : request.highest)[axis] = at;
  }
}

/// The cage around a mesh, and around its images in the planes of the setup, but for a box whose vertices handles hold. It is its
/// own mirror image, also if the mesh is.
Mesh generated(const Mesh& mesh, const v1::Setup& setup, const v1::CageMethod& cage) {
  CageRequest request = cage_request(cage);
  const auto planes = mirror_planes(setup, mesh);
  for (std::size_t i = 0; i < planes.size(); ++i) {
    if (planes[i]) continue;
    refuse("symmetry[" + std::to_string(i) +
           "] is a region that is not perpendicular to an axis; give the plane by `point` and `normal`");
  }
  if (planes.empty()) return cage_around(mesh, request).mesh;
  const bool held = cage.control() != v1::MESH;  // its vertices are, by handles
  if (request.kind == CageKind::box && held) {
    end_in_planes(planes, mesh, request);
    return cage_around(mesh, request).mesh;
  }
  if (request.kind != CageKind::box) {
    for (const auto& plane : planes) request.planes.push_back({plane->point, plane->normal});
    try {
      return cage_around(mesh, request).mesh;
    } catch (const Error& error) {
      if (held || error.code() != ErrorCode::failed_precondition) throw;
    }
    request.planes.clear();  // one that is no mirror image does as well
  }
  return cage_around(whole_model(mesh, planes), request).mesh;
}

}  // namespace

void fill_cage(const std::filesystem::path& folder, const std::string& field, const MeshSource& mesh, const v1::Setup& setup,
               v1::Method& method) {
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
      take_mesh(generated(*mesh(), setup, cage), "the cage", cage);
    }
  } catch (const Error& error) {
    throw Error(error.code(), source + ": " + error.what());
  }
  cage.clear_file();
  cage.clear_generate();
}

}  // namespace deform::client
