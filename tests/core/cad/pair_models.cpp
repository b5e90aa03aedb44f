// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/core/cad/pair_models.h"

#include <BRepAlgoAPI_Cut.hxx>
#include <BRepAlgoAPI_Fuse.hxx>
#include <BRepBndLib.hxx>
#include <BRepBuilderAPI_MakeSolid.hxx>
#include <BRepBuilderAPI_MakeVertex.hxx>
#include <BRepBuilderAPI_Sewing.hxx>
#include <BRepBuilderAPI_Transform.hxx>
#include <BRepExtrema_DistShapeShape.hxx>
#include <BRepLib.hxx>
#include <BRepMesh_IncrementalMesh.hxx>
#include <BRepPrimAPI_MakeBox.hxx>
#include <BRepPrimAPI_MakeCylinder.hxx>
#include <BRepPrimAPI_MakeTorus.hxx>
#include <BRep_Builder.hxx>
#include <BRep_Tool.hxx>
#include <Bnd_Box.hxx>
#include <Geom_Surface.hxx>
#include <Poly_Triangulation.hxx>
#include <ShapeUpgrade_UnifySameDomain.hxx>
#include <TopExp.hxx>
#include <TopExp_Explorer.hxx>
#include <TopTools_IndexedMapOfShape.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Compound.hxx>
#include <TopoDS_Shell.hxx>
#include <TopoDS_Solid.hxx>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace deform::cad {

namespace {

gp_Pnt pnt(const Vec3& p) { return {p[0], p[1], p[2]}; }
gp_Dir dir(const Vec3& d) { return {d[0], d[1], d[2]}; }

TopoDS_Shape transformed(const TopoDS_Shape& shape, const gp_Trsf& map) {
  return BRepBuilderAPI_Transform(shape, map, true).Shape();
}

}  // namespace

TopoDS_Shape block(const Vec3& corner, const Vec3& size) {
  return BRepPrimAPI_MakeBox(pnt(corner), size[0], size[1], size[2]).Shape();
}

TopoDS_Shape rod(const Vec3& start, const Vec3& axis, double radius, double height) {
  return BRepPrimAPI_MakeCylinder(gp_Ax2(pnt(start), dir(axis)), radius, height).Shape();
}

TopoDS_Shape rod(const Vec3& start, const Vec3& axis, const Vec3& seam, double radius, double height) {
  return BRepPrimAPI_MakeCylinder(gp_Ax2(pnt(start), dir(axis), dir(seam)), radius, height).Shape();
}

TopoDS_Shape without(const TopoDS_Shape& shape, const TopoDS_Shape& tool) { return BRepAlgoAPI_Cut(shape, tool).Shape(); }

TopoDS_Shape joined(const TopoDS_Shape& a, const TopoDS_Shape& b) { return BRepAlgoAPI_Fuse(a, b).Shape(); }

TopoDS_Shape smoothed(const TopoDS_Shape& shape) {
  ShapeUpgrade_UnifySameDomain unify(shape, true, true, false);
  unify.Build();
  return unify.Shape();
}

TopoDS_Shape turned(const TopoDS_Shape& shape, const Vec3& centre, const Vec3& axis, double degrees) {
  gp_Trsf map;
  map.SetRotation(gp_Ax1(pnt(centre), dir(axis)), degrees * std::numbers::pi / 180);
  return transformed(shape, map);
}

TopoDS_Shape shifted(const TopoDS_Shape& shape, const Vec3& by) {
  gp_Trsf map;
  map.SetTranslation(gp_Vec(by[0], by[1], by[2]));
  return transformed(shape, map);
}

TopoDS_Shape scaled(const TopoDS_Shape& shape, double factor) {
  gp_Trsf map;
  map.SetScale(gp_Pnt(0, 0, 0), factor);
  return transformed(shape, map);
}

TopoDS_Shape mirrored(const TopoDS_Shape& shape, const Vec3& normal) {
  gp_Trsf map;
  map.SetMirror(gp_Ax2(gp_Pnt(0, 0, 0), dir(normal)));
  return transformed(shape, map);
}

TopoDS_Shape together(const std::vector<TopoDS_Shape>& shapes) {
  TopoDS_Compound all;
  const BRep_Builder builder;
  builder.MakeCompound(all);
  for (const TopoDS_Shape& shape : shapes) builder.Add(all, shape);
  return all;
}

std::vector<TopoDS_Face> faces_of(const TopoDS_Shape& shape) {
  TopTools_IndexedMapOfShape map;
  TopExp::MapShapes(shape, TopAbs_FACE, map);
  std::vector<TopoDS_Face> faces;
  for (int f = 1; f <= map.Extent(); ++f) faces.push_back(TopoDS::Face(map(f)));
  return faces;
}

TopoDS_Shape renumbered(const TopoDS_Shape& shape, int step) {
  const std::vector<TopoDS_Face> faces = faces_of(shape);
  BRepBuilderAPI_Sewing sewing(1e-6);
  for (std::size_t i = 0; i < faces.size(); ++i) sewing.Add(faces[(1 + i * static_cast<std::size_t>(step)) % faces.size()]);
  sewing.Perform();
  TopoDS_Solid solid = BRepBuilderAPI_MakeSolid(TopoDS::Shell(sewing.SewedShape())).Solid();
  BRepLib::OrientClosedSolid(solid);
  return solid;
}

TopoDS_Shape sheet(const TopoDS_Shape& shape, const std::vector<int>& left_out, const std::vector<int>& turned_round) {
  const auto has = [](const std::vector<int>& list, int f) { return std::find(list.begin(), list.end(), f) != list.end(); };
  TopoDS_Shell shell;
  const BRep_Builder builder;
  builder.MakeShell(shell);
  const std::vector<TopoDS_Face> faces = faces_of(shape);
  for (int f = 0; f < static_cast<int>(faces.size()); ++f) {
    if (!has(left_out, f)) builder.Add(shell, has(turned_round, f) ? faces[f].Reversed() : TopoDS_Shape(faces[f]));
  }
  return shell;
}

TopoDS_Shape bored(const Vec3& size, const Vec3& at, double radius) {
  return without(block({0, 0, 0}, size), rod({at[0], at[1], -1}, {0, 0, 1}, radius, size[2] + 2));
}

TopoDS_Shape row_of_bores(double first) {
  TopoDS_Shape plate = block({0, 0, 0}, {10, 2, 0.5});
  for (int i = 0; i < 4; ++i) plate = without(plate, rod({first + 2 * i, 1, -1}, {0, 0, 1}, 0.4, 3));
  return plate;
}

TopoDS_Shape pipe(const PipeSizes& sizes) {
  const double angle = sizes.degrees * std::numbers::pi / 180;
  const auto solid = [&](double radius) {
    const Vec3 centre{sizes.bend, 0, sizes.first_leg};  // of the bend
    const Vec3 end{centre[0] - sizes.bend * std::cos(angle), 0, centre[2] + sizes.bend * std::sin(angle)};
    const gp_Ax2 bend_axis(pnt(centre), gp_Dir(0, 1, 0), gp_Dir(-1, 0, 0));
    const TopoDS_Shape bend = BRepPrimAPI_MakeTorus(bend_axis, sizes.bend, radius, angle).Shape();
    const TopoDS_Shape first = rod({0, 0, 0}, {0, 0, 1}, {-1, 0, 0}, radius, sizes.first_leg);
    const TopoDS_Shape second =
        rod(end, {std::sin(angle), 0, std::cos(angle)}, {-std::cos(angle), 0, std::sin(angle)}, radius, sizes.second_leg);
    return smoothed(joined(joined(first, bend), second));
  };
  return without(solid(sizes.outer), solid(sizes.inner));
}

Mesh mesh_of(const TopoDS_Shape& shape, double deflection, int splits) {
  const BRepMesh_IncrementalMesh meshed(shape, deflection, false, 0.4, false);
  Mesh mesh;
  for (const TopoDS_Face& face : faces_of(shape)) {
    TopLoc_Location location;
    const auto triangulation = BRep_Tool::Triangulation(face, location);
    if (triangulation.IsNull()) continue;
    const auto surface = BRep_Tool::Surface(face);
    const auto first = static_cast<PointId>(mesh.points.size());
    std::vector<gp_Pnt2d> uv;
    const auto add = [&](const gp_Pnt2d& at, const gp_Pnt& p) {
      uv.push_back(at);
      mesh.points.push_back({p.X(), p.Y(), p.Z()});
      return static_cast<PointId>(mesh.points.size() - 1);
    };
    for (int i = 1; i <= triangulation->NbNodes(); ++i) {
      add(triangulation->UVNode(i), triangulation->Node(i).Transformed(location.Transformation()));
    }
    std::vector<std::array<PointId, 3>> triangles;
    for (int t = 1; t <= triangulation->NbTriangles(); ++t) {
      int a = 0, b = 0, c = 0;
      triangulation->Triangle(t).Get(a, b, c);
      if (face.Orientation() == TopAbs_REVERSED) std::swap(b, c);
      triangles.push_back({first + a - 1, first + b - 1, first + c - 1});
    }
    for (int pass = 0; pass < splits; ++pass) {
      std::vector<std::array<PointId, 3>> finer;
      for (const auto& [a, b, c] : triangles) {
        const gp_XY middle = (uv[a - first].XY() + uv[b - first].XY() + uv[c - first].XY()) / 3;
        const PointId m = add(gp_Pnt2d(middle), surface->Value(middle.X(), middle.Y()));
        finer.push_back({a, b, m});
        finer.push_back({b, c, m});
        finer.push_back({c, a, m});
      }
      triangles = std::move(finer);
    }
    for (const auto& triangle : triangles) {
      mesh.face_sizes.push_back(3);
      mesh.face_points.insert(mesh.face_points.end(), triangle.begin(), triangle.end());
    }
  }
  return mesh;
}

TopoDS_Shape skin(const TopoDS_Shape& shape) {
  std::vector<TopoDS_Shape> faces;
  for (const TopoDS_Face& face : faces_of(shape)) faces.push_back(face);
  return together(faces);
}

double distance_from(const Vec3& point, const TopoDS_Shape& shape) {
  return BRepExtrema_DistShapeShape(BRepBuilderAPI_MakeVertex(pnt(point)).Vertex(), shape).Value();
}

double diagonal_of(const TopoDS_Shape& shape) {
  Bnd_Box box;
  BRepBndLib::AddOptimal(shape, box, false, false);
  return std::sqrt(box.SquareExtent());
}

}  // namespace deform::cad
