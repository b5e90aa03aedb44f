// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/crossing_faces.h"

#include <BRepMesh_IncrementalMesh.hxx>
#include <BRepTools.hxx>
#include <BRep_Tool.hxx>
#include <Poly_Triangulation.hxx>
#include <TopExp.hxx>
#include <TopTools_IndexedMapOfShape.hxx>
#include <algorithm>
#include <cmath>
#include <vector>

#include "core/base/vectors.h"

namespace deform::cad {

namespace {

constexpr double angle = 0.5;      ///< of neighbouring triangles, radians
constexpr double touching = 0.01;  ///< of the deflection

struct FaceTriangle {
  std::array<Vec3, 3> corners;
  Vec3 min, max;
  int face = 0;
};

void add_triangles(const TopoDS_Face& face, int number, std::vector<FaceTriangle>& triangles) {
  TopLoc_Location place;
  const Handle(Poly_Triangulation) mesh = BRep_Tool::Triangulation(face, place);
  if (mesh.IsNull()) return;
  for (int k = 1; k <= mesh->NbTriangles(); ++k) {
    FaceTriangle triangle;
    triangle.face = number;
    std::array<int, 3> ids{};
    mesh->Triangle(k).Get(ids[0], ids[1], ids[2]);
    for (int c = 0; c < 3; ++c) {
      const gp_Pnt p = mesh->Node(ids[c]).Transformed(place);
      triangle.corners[c] = {p.X(), p.Y(), p.Z()};
    }
    triangle.min = triangle.max = triangle.corners[0];
    for (const Vec3& p : triangle.corners) {
      for (int d = 0; d < 3; ++d)
        triangle.min[d] = std::min(triangle.min[d], p[d]), triangle.max[d] = std::max(triangle.max[d], p[d]);
    }
    triangles.push_back(triangle);
  }
}

/// Whether a segment goes through a triangle (Moeller, Trumbore 1997), with both ends farther than the margin from its plane:
/// what touches does not.
bool crosses(const Vec3& a, const Vec3& b, const std::array<Vec3, 3>& t, double margin) {
  const Vec3 way = b - a, u = t[1] - t[0], v = t[2] - t[0], p = cross(way, v);
  const double determinant = dot(u, p);
  if (determinant == 0) return false;
  const Vec3 from = a - t[0], q = cross(from, u);
  const double x = dot(from, p) / determinant, y = dot(way, q) / determinant, s = dot(v, q) / determinant;
  if (!(x >= 0 && y >= 0 && x + y <= 1 && s > 0 && s < 1)) return false;
  const double across = std::abs(determinant) / norm(cross(u, v));  // of the segment, along the normal
  return s * across > margin && (1 - s) * across > margin;
}

bool cross_each_other(const FaceTriangle& a, const FaceTriangle& b, double margin) {
  for (int d = 0; d < 3; ++d) {
    if (a.max[d] < b.min[d] || b.max[d] < a.min[d]) return false;
  }
  for (int k = 0; k < 3; ++k) {
    if (crosses(a.corners[k], a.corners[(k + 1) % 3], b.corners, margin) ||
        crosses(b.corners[k], b.corners[(k + 1) % 3], a.corners, margin))
      return true;
  }
  return false;
}

/// The vertices of each face, ascending.
std::vector<std::vector<int>> corners_of(const Model& model) {
  std::vector<std::vector<int>> corners(model.face_count());
  for (int f = 0; f < model.face_count(); ++f) {
    TopTools_IndexedMapOfShape vertices;
    TopExp::MapShapes(model.face(f), TopAbs_VERTEX, vertices);
    for (int k = 1; k <= vertices.Extent(); ++k) corners[f].push_back(model.vertices.FindIndex(vertices(k)));
    std::sort(corners[f].begin(), corners[f].end());
  }
  return corners;
}

bool have_common(const std::vector<int>& a, const std::vector<int>& b) {
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (a[i] == b[j]) return true;
    if (a[i] < b[j]) {
      ++i;
    } else {
      ++j;
    }
  }
  return false;
}

}  // namespace

std::set<std::array<int, 2>> crossing_faces(const Model& model, double deflection, const RunContext& context) {
  BRepTools::Clean(model.shape);
  const BRepMesh_IncrementalMesh mesher(model.shape, deflection, false, angle, true);
  std::vector<FaceTriangle> triangles;
  for (int f = 0; f < model.face_count(); ++f) add_triangles(model.face(f), f, triangles);
  BRepTools::Clean(model.shape);
  // Along x, those that begin before another one ends.
  std::sort(triangles.begin(), triangles.end(), [](const FaceTriangle& a, const FaceTriangle& b) { return a.min[0] < b.min[0]; });
  const std::vector<std::vector<int>> corners = corners_of(model);
  std::set<std::array<int, 2>> pairs;
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    if (i % 256 == 0) context.check();
    const FaceTriangle& a = triangles[i];
    for (std::size_t j = i + 1; j < triangles.size() && triangles[j].min[0] <= a.max[0]; ++j) {
      const FaceTriangle& b = triangles[j];
      if (a.face == b.face || !cross_each_other(a, b, touching * deflection)) continue;
      if (!have_common(corners[a.face], corners[b.face])) pairs.insert({std::min(a.face, b.face), std::max(a.face, b.face)});
    }
  }
  return pairs;
}

}  // namespace deform::cad
