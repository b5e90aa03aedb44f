// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/remeshing/triangles.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "core/base/error.h"
#include "core/base/vectors.h"

namespace deform {

namespace {

constexpr double least_cosine = 0.2;  // of the angle between normals before and after
constexpr double least_shape = 0.01;  // twice the area over the square of the longest edge, 0.87 where equilateral

bool folds(const Vec3& before, const Vec3& a, const Vec3& b, const Vec3& c) {
  const Vec3 after = cross(b - a, c - a);
  const double longest_square = std::max({squared_distance(a, b), squared_distance(b, c), squared_distance(c, a)});
  const double size = length(after);
  return size < least_shape * longest_square || dot(before, after) < least_cosine * length(before) * size;
}

template <typename Measure>
void for_each_least_angle(const SurfaceMesh& mesh, const Measure& measure) {
  for (const FaceHandle f : mesh.faces()) {
    const HalfedgeHandle h = mesh.halfedge(f);
    measure(least_angle(mesh.point(mesh.source(h)), mesh.point(mesh.target(h)), mesh.point(mesh.target(mesh.next(h)))));
  }
}

}  // namespace

void check_closed_triangles(const SurfaceMesh& mesh) {
  for (const FaceHandle f : mesh.faces()) {
    if (mesh.is_triangle(f)) continue;
    throw Error(ErrorCode::invalid_argument, "face " + std::to_string(f.index()) + " is no triangle");
  }
  for (const EdgeHandle e : mesh.edges()) {
    if (!mesh.is_boundary(e)) continue;
    const HalfedgeHandle h = SurfaceMesh::halfedge(e);
    throw Error(ErrorCode::invalid_argument, "the surface is not closed: edge " + std::to_string(mesh.source(h).index()) + "-" +
                                                 std::to_string(mesh.target(h).index()) + " is on a boundary");
  }
}

Vec3 area_normal(const SurfaceMesh& mesh, FaceHandle f) {
  const HalfedgeHandle h = mesh.halfedge(f);
  const Vec3& a = mesh.point(mesh.source(h));
  return cross(mesh.point(mesh.target(h)) - a, mesh.point(mesh.target(mesh.next(h))) - a);
}

bool would_fold(const SurfaceMesh& mesh, HalfedgeHandle h, const Vec3& x) {
  const FaceHandle left = mesh.face(h), right = mesh.face(SurfaceMesh::opposite(h));
  for (const HalfedgeHandle out : mesh.outgoing(mesh.source(h))) {
    const FaceHandle f = mesh.face(out);
    if (!f.valid() || f == left || f == right) continue;
    if (folds(area_normal(mesh, f), x, mesh.point(mesh.target(out)), mesh.point(mesh.target(mesh.next(out))))) return true;
  }
  return false;
}

bool would_fold(const SurfaceMesh& mesh, VertexHandle v, const Vec3& x) {
  for (const HalfedgeHandle out : mesh.outgoing(v)) {
    const FaceHandle f = mesh.face(out);
    if (f.valid() && folds(area_normal(mesh, f), x, mesh.point(mesh.target(out)), mesh.point(mesh.target(mesh.next(out)))))
      return true;
  }
  return false;
}

double least_angle(const Vec3& a, const Vec3& b, const Vec3& c) {
  const double twice_area = length(cross(b - a, c - a));
  if (twice_area == 0) return 0;
  double least = std::numbers::pi;
  for (const double cosine : {dot(b - a, c - a), dot(c - b, a - b), dot(a - c, b - c)}) {
    least = std::min(least, std::atan2(twice_area, cosine));
  }
  return least * 180 / std::numbers::pi;
}

double least_angle(const SurfaceMesh& mesh) {
  double least = 180;
  for_each_least_angle(mesh, [&](double angle) { least = std::min(least, angle); });
  return least;
}

double mean_least_angle(const SurfaceMesh& mesh) {
  double sum = 0;
  for_each_least_angle(mesh, [&](double angle) { sum += angle; });
  return mesh.face_count() == 0 ? 180 : sum / static_cast<double>(mesh.face_count());
}

}  // namespace deform
