// SPDX-License-Identifier: Apache-2.0
#include "client/setup/mirror_planes.h"

#include <string>

#include "core/base/vectors.h"
#include "core/mesh/region.h"
#include "proto/convert/mesh/region.h"

namespace deform::client {

namespace {

/// The plane of a region that is flat along one axis, which the mesh is not.
std::optional<MirrorPlane> plane_of(const v1::Region& region, const Mesh& mesh, const std::string& what) {
  const Box all = bounding_box(mesh.points);
  Box flat;
  for (const PointId id : select(convert::region_from_proto(region, what), mesh, what)) flat.add(mesh.points[id]);
  for (std::size_t k = 0; k < 3; ++k) {
    const double limit = MirrorPlane::flatness * all.diagonal();
    if (flat.max[k] - flat.min[k] > limit || all.max[k] - all.min[k] <= limit) continue;
    MirrorPlane plane{flat.min, {}};
    plane.point[k] = 0.5 * (flat.min[k] + flat.max[k]);
    plane.normal[k] = 1;
    return plane;
  }
  return std::nullopt;
}

}  // namespace

Vec3 MirrorPlane::reflected(const Vec3& x) const { return x - 2 * dot(normal, x - point) * normal; }

std::vector<std::optional<MirrorPlane>> mirror_planes(const v1::Setup& setup, const Mesh& mesh) {
  std::vector<std::optional<MirrorPlane>> planes;
  for (int i = 0; i < setup.symmetry_size(); ++i) {
    const v1::SymmetryPlane& given = setup.symmetry(i);
    if (given.has_sector()) return {};
    planes.emplace_back();
    if (given.has_region()) {
      planes.back() = plane_of(given.region(), mesh, "symmetry[" + std::to_string(i) + "].region");
      continue;
    }
    if (given.point_size() != 3 || given.normal_size() != 3) continue;  // which the server refuses
    MirrorPlane plane;
    for (int k = 0; k < 3; ++k) plane.point[k] = given.point(k), plane.normal[k] = given.normal(k);
    const double length = norm(plane.normal);
    if (!(length > 0)) continue;
    plane.normal = plane.normal / length;
    planes.back() = plane;
  }
  return planes;
}

Mesh whole_model(const Mesh& mesh, const std::vector<std::optional<MirrorPlane>>& planes) {
  Mesh whole;
  whole.points = mesh.points;
  whole.face_sizes = mesh.face_sizes;
  whole.face_points = mesh.face_points;
  for (const auto& plane : planes) {
    const std::size_t points = whole.points.size(), faces = whole.face_sizes.size(), corners = whole.face_points.size();
    for (std::size_t i = 0; i < points; ++i) whole.points.push_back(plane->reflected(whole.points[i]));
    for (std::size_t f = 0; f < faces; ++f) whole.face_sizes.push_back(whole.face_sizes[f]);
    for (std::size_t c = 0; c < corners; ++c) whole.face_points.push_back(whole.face_points[c] + static_cast<PointId>(points));
  }
  return whole;
}

}  // namespace deform::client
