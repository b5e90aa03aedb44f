// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/cad_move.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <BRepAlgoAPI_Cut.hxx>
#include <BRepAlgoAPI_Fuse.hxx>
#include <BRepBuilderAPI_MakeEdge.hxx>
#include <BRepBuilderAPI_MakeFace.hxx>
#include <BRepBuilderAPI_MakeSolid.hxx>
#include <BRepBuilderAPI_MakeWire.hxx>
#include <BRepBuilderAPI_NurbsConvert.hxx>
#include <BRepBuilderAPI_Sewing.hxx>
#include <BRepBuilderAPI_Transform.hxx>
#include <BRepPrimAPI_MakeBox.hxx>
#include <BRepPrimAPI_MakeCone.hxx>
#include <BRepPrimAPI_MakeCylinder.hxx>
#include <BRepPrimAPI_MakePrism.hxx>
#include <BRepTools.hxx>
#include <BRep_Builder.hxx>
#include <Geom_BSplineSurface.hxx>
#include <TColStd_Array1OfInteger.hxx>
#include <TColStd_Array1OfReal.hxx>
#include <TColgp_Array2OfPnt.hxx>
#include <TopExp.hxx>
#include <TopTools_IndexedMapOfShape.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Shell.hxx>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <gp_Circ.hxx>
#include <memory>
#include <numbers>

#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/mesh/elements.h"

namespace deform::cad::cad_move_test {
namespace {

using testing::HasSubstr;

class CadMove : public testing::Test {
 protected:
  /// A file of this test with the shape.
  std::filesystem::path file(const TopoDS_Shape& shape, const std::string& name) {
    const auto* test = testing::UnitTest::GetInstance()->current_test_info();
    const auto path = std::filesystem::temp_directory_path() / ("deform_cad_" + std::string(test->name()) + "_" + name + ".brep");
    BRepTools::Write(shape, path.c_str());
    files_.push_back(path);
    return path;
  }
  void TearDown() override {
    for (const auto& path : files_) std::filesystem::remove(path);
  }
  CarriedNodes carry(const TopoDS_Shape& before, const TopoDS_Shape& after, const Mesh& mesh,
                     std::vector<ForcedPair> pairs = {}) {
    MoveRequest request;
    request.before = file(before, "before");
    request.after = file(after, "after");
    request.pairs = std::move(pairs);
    return carry_nodes(mesh, request);
  }
  std::string refusal(const TopoDS_Shape& before, const TopoDS_Shape& after, const Mesh& mesh) {
    try {
      carry(before, after, mesh);
    } catch (const Error& error) {
      return error.what();
    }
    return "nothing was refused";
  }

 private:
  std::vector<std::filesystem::path> files_;
};

TopoDS_Shape box(double x, double y, double z) { return BRepPrimAPI_MakeBox(x, y, z).Shape(); }

/// A grid of n x n quadrilaterals, in place (a, b) in [0, 1]^2.
void add_grid(Mesh& mesh, int n, const std::function<Vec3(double, double)>& place) {
  const auto first = static_cast<PointId>(mesh.points.size());
  for (int j = 0; j <= n; ++j) {
    for (int i = 0; i <= n; ++i) mesh.points.push_back(place(static_cast<double>(i) / n, static_cast<double>(j) / n));
  }
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i < n; ++i) {
      const PointId p = first + static_cast<PointId>(i + j * (n + 1));
      mesh.face_sizes.push_back(4);
      for (const PointId q : {p, p + 1, p + n + 2, p + n + 1}) mesh.face_points.push_back(q);
    }
  }
}

/// The surface of a box with a corner at the origin; points of edges are there twice.
Mesh box_mesh(double x, double y, double z, int n) {
  Mesh mesh;
  for (const double s : {0.0, 1.0}) {
    add_grid(mesh, n, [&](double a, double b) { return Vec3{a * x, b * y, s * z}; });
    add_grid(mesh, n, [&](double a, double b) { return Vec3{a * x, s * y, b * z}; });
    add_grid(mesh, n, [&](double a, double b) { return Vec3{s * x, a * y, b * z}; });
  }
  return mesh;
}

Mesh cylinder_mesh(double radius, double height) {
  Mesh mesh;
  add_grid(mesh, 12, [&](double a, double b) {
    const double angle = 2 * std::numbers::pi * a;
    return Vec3{radius * std::cos(angle), radius * std::sin(angle), b * height};
  });
  return mesh;
}

TEST_F(CadMove, ABoxBecomesAnotherByAnAffineMap) {
  const Mesh mesh = box_mesh(1, 2, 3, 6);
  const CarriedNodes carried = carry(box(1, 2, 3), box(1.5, 2, 2.5), mesh);
  ASSERT_EQ(carried.nodes.size(), mesh.point_count());
  for (std::size_t i = 0; i < carried.nodes.size(); ++i) {
    const Vec3& p = mesh.points[carried.nodes[i]];
    EXPECT_LT(distance(carried.places[i], {1.5 * p[0], p[1], p[2] / 1.2}), 1e-9) << i;
  }
  EXPECT_EQ(carried.flipped(), 0u);
  EXPECT_EQ(carried.outside(), 0u);
  EXPECT_LT(carried.distance, 1e-9 * carried.diagonal);
  std::size_t triangles = 0;
  for (const FaceOutcome& face : carried.faces) triangles += face.triangles;
  EXPECT_EQ(triangles, 6u * 36 * 2);
}

TEST_F(CadMove, FacesInsideOfAVolumeMeshLieOnNoFaceOfTheModel) {
  // Eight hexahedra in a cube, whose middle layer of nodes is slanted; the faces are those at the bottom and two of that layer,
  // of which every triangle has the node in the middle.
  Mesh mesh;
  for (const int k : {0, 1, 2}) {
    add_grid(mesh, 2, [&](double a, double b) {
      return Vec3{2 * a, 2 * b, k + (k == 1 ? 0.3 * (a - 0.5) + 0.5 * (b - 0.5) : 0)};
    });
  }
  mesh.face_points.resize(4 * 4);
  for (const PointId q : {9, 10, 13, 12, 13, 14, 17, 16}) mesh.face_points.push_back(q);
  mesh.face_sizes.resize(6);
  auto elements = std::make_shared<Elements>();
  for (const PointId p : {0, 1, 3, 4, 9, 10, 12, 13}) {
    elements->add(ElementType::hexahedron, std::vector<PointId>{p, p + 1, p + 4, p + 3, p + 9, p + 10, p + 13, p + 12});
  }
  mesh.elements = elements;
  const CarriedNodes carried = carry(box(2, 2, 2), box(3, 2, 2), mesh);
  EXPECT_EQ(carried.nodes.size(), 26u) << "all but the one in the middle";
  std::size_t triangles = 0;
  for (const FaceOutcome& face : carried.faces) triangles += face.triangles;
  EXPECT_EQ(triangles, 2 * 4u) << "those at the bottom";
  EXPECT_EQ(carried.flipped(), 0u);
}

TEST_F(CadMove, NodesKeepTheirBitsWhereTheModelStays) {
  const Mesh mesh = box_mesh(1, 2, 3, 6);
  EXPECT_EQ(carry(box(1, 2, 3), box(1, 2, 3), mesh).places, mesh.points);
}

TEST_F(CadMove, ACylinderGrowsAlongItsRadiusAndAxis) {
  const Mesh mesh = cylinder_mesh(1, 3);
  const CarriedNodes carried = carry(BRepPrimAPI_MakeCylinder(1, 3).Shape(), BRepPrimAPI_MakeCylinder(2, 4).Shape(), mesh);
  for (std::size_t i = 0; i < carried.nodes.size(); ++i) {
    const Vec3& p = mesh.points[carried.nodes[i]];
    EXPECT_LT(distance(carried.places[i], {2 * p[0], 2 * p[1], p[2] * 4 / 3}), 1e-8) << i;
  }
  EXPECT_EQ(carried.flipped(), 0u);
  EXPECT_GT(carried.on_edges, 20u);  // both circles, and the seam
}

TEST_F(CadMove, FacesAreFoundWhateverTheirOrder) {
  gp_Trsf turn;
  turn.SetRotation(gp::OZ(), std::numbers::pi / 2);
  gp_Trsf back;
  back.SetTranslation(gp_Vec(1, 0, 0));
  // The same box again, its faces in another order.
  const TopoDS_Shape turned = BRepBuilderAPI_Transform(box(2, 1, 3), back * turn, true).Shape();
  const Mesh mesh = box_mesh(1, 2, 3, 4);
  const CarriedNodes carried = carry(box(1, 2, 3), turned, mesh);
  for (std::size_t i = 0; i < carried.nodes.size(); ++i)
    EXPECT_LT(distance(carried.places[i], mesh.points[carried.nodes[i]]), 1e-9) << i;
}

/// A prism on an arc from -170 to 100 degrees and two lines, of which the first goes on along its tangent.
TopoDS_Shape arc_and_tangent(double size) {
  const gp_Circ circle(gp::XOY(), size);
  const double from = -170 * std::numbers::pi / 180, to = 100 * std::numbers::pi / 180;
  const gp_Pnt start(size * std::cos(from), size * std::sin(from), 0), end(size * std::cos(to), size * std::sin(to), 0);
  const gp_Pnt corner = end.Translated(0.5 * size * gp_Vec(-std::sin(to), std::cos(to), 0));
  BRepBuilderAPI_MakeWire wire(BRepBuilderAPI_MakeEdge(circle, from, to).Edge());
  wire.Add(BRepBuilderAPI_MakeEdge(end, corner).Edge());
  wire.Add(BRepBuilderAPI_MakeEdge(corner, start).Edge());
  return BRepPrimAPI_MakePrism(BRepBuilderAPI_MakeFace(wire.Wire()).Face(), gp_Vec(0, 0, size)).Shape();
}

TEST_F(CadMove, AnArcHoldsNoNodesBeyondItsEnd) {
  for (const double size : {1.0, 1000.0}) {
    // Beside the line by 2e-5, as in a file with few digits: the circle beyond the end of the arc is as near as that or nearer.
    const double turn = 100 * std::numbers::pi / 180;
    const Vec3 out{std::cos(turn), std::sin(turn), 0}, along{-std::sin(turn), std::cos(turn), 0};
    Mesh mesh;
    for (const double s : {0.005, 0.006, 0.007, 0.008, 0.009}) {
      const auto first = static_cast<PointId>(mesh.points.size());
      for (const Vec3& p : {(1 - 2e-5) * out + s * along, out + (s + 0.2) * along, Vec3{0, 0, 0}})
        mesh.points.push_back(size * p);
      for (PointId k = 0; k < 3; ++k) mesh.face_points.push_back(first + k);
      mesh.face_sizes.push_back(3);
    }
    const TopoDS_Shape before = arc_and_tangent(size);
    gp_Trsf shift;
    shift.SetTranslation(gp_Vec(0, 0, 2 * size));
    const CarriedNodes carried = carry(before, BRepBuilderAPI_Transform(before, shift, true).Shape(), mesh);
    for (std::size_t i = 0; i < carried.nodes.size(); ++i) {
      const Vec3& p = mesh.points[carried.nodes[i]];
      EXPECT_LT(distance(carried.places[i], p + Vec3{0, 0, 2 * size}), 2.1e-5 * size) << i;
    }
  }
}

/// A part of a disc with a hole, from angle 0 on.
TopoDS_Face sector(double inner, double outer, double angle) {
  const auto at = [](double radius, double turn) { return gp_Pnt(radius * std::cos(turn), radius * std::sin(turn), 0); };
  BRepBuilderAPI_MakeWire wire(BRepBuilderAPI_MakeEdge(gp_Circ(gp::XOY(), outer), 0, angle).Edge());
  wire.Add(BRepBuilderAPI_MakeEdge(at(outer, angle), at(inner, angle)).Edge());
  wire.Add(BRepBuilderAPI_MakeEdge(gp_Circ(gp::XOY(), inner), 0, angle).Edge());
  wire.Add(BRepBuilderAPI_MakeEdge(at(outer, 0), at(inner, 0)).Edge());
  return BRepBuilderAPI_MakeFace(wire.Wire()).Face();
}
/// A prism on it with its faces from the one with this number on.
TopoDS_Shape thick(const TopoDS_Face& face, int first) {
  TopTools_IndexedMapOfShape faces;
  TopExp::MapShapes(BRepPrimAPI_MakePrism(face, gp_Vec(0, 0, 1)).Shape(), TopAbs_FACE, faces);
  TopoDS_Shell shell;
  const BRep_Builder builder;
  builder.MakeShell(shell);
  for (int k = 0; k < faces.Extent(); ++k) builder.Add(shell, faces((first - 1 + k) % faces.Extent() + 1));
  return BRepBuilderAPI_MakeSolid(shell).Solid();
}

TEST_F(CadMove, ThinFacesHoldTheirNodes) {
  Mesh mesh;  // along the middle of the thin face
  for (int k = 0; k < 80; ++k) {
    const double turn = 0.05 + 0.025 * k;
    for (const auto& [radius, angle] : {std::pair{1.003, turn}, {1.005, turn}, {1.004, turn + 0.005}}) {
      mesh.face_points.push_back(static_cast<PointId>(mesh.points.size()));
      mesh.points.push_back({radius * std::cos(angle), radius * std::sin(angle), 0});
    }
    mesh.face_sizes.push_back(3);
  }
  // Whichever of the faces the thin ones are, the first and the last, too.
  const TopoDS_Face before = sector(1, 1.008, 2.1), after = sector(1.3, 1.307, 1.5);
  for (int first = 1; first <= 6; ++first) {
    const CarriedNodes carried = carry(thick(before, first), thick(after, first), mesh);
    for (const FaceOutcome& face : carried.faces) EXPECT_EQ(face.warp_outside, 0u);
    for (std::size_t i = 0; i < carried.nodes.size(); ++i) {
      const Vec3& p = carried.places[i];
      const double share = (length(mesh.points[i]) - 1) / 0.008;
      EXPECT_NEAR((std::hypot(p[0], p[1]) - 1.3) / 0.007, share, 0.05) << i;
    }
  }
}

/// A cubic spline with n x n control points, those at the rim of it on the rim of the unit square where `pole` leaves them.
Handle(Geom_BSplineSurface) spline_of(int n, const std::function<Vec3(double, double)>& pole) {
  TColgp_Array2OfPnt poles(1, n, 1, n);
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      const Vec3 p = pole(static_cast<double>(i) / (n - 1), static_cast<double>(j) / (n - 1));
      poles(i + 1, j + 1) = gp_Pnt(p[0], p[1], p[2]);
    }
  }
  TColStd_Array1OfReal knots(1, n - 2);
  TColStd_Array1OfInteger multiplicities(1, n - 2);
  multiplicities.Init(1);
  multiplicities(1) = multiplicities(n - 2) = 4;
  for (int i = 1; i <= n - 2; ++i) knots(i) = static_cast<double>(i - 1) / (n - 3);
  return new Geom_BSplineSurface(poles, knots, knots, multiplicities, multiplicities, 3, 3);
}

/// Sewing leaves curves in (u, v) that far from their edges.
constexpr double sewn = 1e-6;

/// A box of 4 x 3 x 2 whose upper face is a spline with the same edges.
TopoDS_Shape under(const Handle(Geom_BSplineSurface) & lid, double size) {
  const TopoDS_Shape plain = box(4 * size, 3 * size, 2 * size);
  BRepBuilderAPI_Sewing sewing(sewn * size);
  TopTools_IndexedMapOfShape faces;
  TopExp::MapShapes(plain, TopAbs_FACE, faces);
  for (int f = 1; f <= 5; ++f) sewing.Add(faces(f));
  sewing.Add(BRepBuilderAPI_MakeFace(lid, sewn * size).Face());
  sewing.Perform();
  return BRepBuilderAPI_MakeSolid(TopoDS::Shell(sewing.SewedShape())).Solid();
}

/// A bulge over the lid of the box, of `height` in the middle; inside, (u, v) are pushed along x by up to `push`.
Handle(Geom_BSplineSurface) bulge(double height, double push, double size) {
  return spline_of(12, [&](double u, double v) {
    const double s = 16 * u * (1 - u) * v * (1 - v);
    return size * Vec3{4 * u + push * s * (1 - u), 3 * v, 2 + height * s * s};
  });
}

class CadFaces : public CadMove {
 protected:
  /// How far nodes on the lid of the box go along x and y, and whether they lie on the new model.
  double slides(const TopoDS_Shape& before, const TopoDS_Shape& after, int n, double size) {
    Mesh mesh;
    add_grid(mesh, n, [&](double a, double b) { return Vec3{4 * size * a, 3 * size * b, 2 * size}; });
    const CarriedNodes carried = carry(before, after, mesh);
    EXPECT_LT(carried.distance, 1e-12 * carried.diagonal);
    EXPECT_EQ(carried.flipped() + carried.outside(), 0u);
    double farthest = 0;
    for (std::size_t i = 0; i < carried.nodes.size(); ++i) {
      const Vec3& p = mesh.points[carried.nodes[i]];
      farthest = std::max(farthest, std::hypot(carried.places[i][0] - p[0], carried.places[i][1] - p[1]));
    }
    return farthest;
  }
};

TEST_F(CadFaces, AFaceThatIsOnlyWrittenWithOtherParametersLeavesItsNodes) {
  for (const double size : {1.0, 1000.0}) {
    for (const int n : {7, 20}) {
      const TopoDS_Shape pushed = under(bulge(0, 1, size), size);
      EXPECT_LT(slides(box(4 * size, 3 * size, 2 * size), pushed, n, size), sewn * size);
      EXPECT_LT(slides(under(bulge(0, 0, size), size), pushed, n, size), sewn * size);
    }
  }
}

TEST_F(CadFaces, ABulgeIsFollowedAlongTheNormalsHoweverItsParametersRun) {
  for (const double push : {0.0, 1.0}) {
    for (const int n : {7, 20}) EXPECT_LT(slides(box(4, 3, 2), under(bulge(1, push, 1), 1), n, 1), sewn);
  }
}

TEST_F(CadFaces, NormalsTurnWithTheFace) {
  const TopoDS_Shape bulged = under(bulge(0.7, 0.5, 1), 1);
  gp_Trsf turn;
  turn.SetRotation(gp_Ax1(gp_Pnt(2, 1.5, 1), gp_Dir(1, 2, 3)), 0.4);
  Mesh mesh;
  add_grid(mesh, 12, [](double a, double b) { return Vec3{4 * a, 3 * b, 2}; });
  const CarriedNodes there = carry(box(4, 3, 2), BRepBuilderAPI_Transform(bulged, turn, true).Shape(), mesh);
  for (std::size_t i = 0; i < there.nodes.size(); ++i) {
    const gp_Pnt back = gp_Pnt(there.places[i][0], there.places[i][1], there.places[i][2]).Transformed(turn.Inverted());
    EXPECT_LT(std::hypot(back.X() - mesh.points[i][0], back.Y() - mesh.points[i][1]), sewn) << i;
  }
}

TEST_F(CadFaces, ASplineWhoseParametersRunAlikeKeepsThem) {
  const auto before = bulge(0, 0, 1), after = bulge(1, 0.1, 1);
  Mesh mesh;
  add_grid(mesh, 12, [&](double a, double b) {
    const gp_Pnt p = before->Value(a, b);
    return Vec3{p.X(), p.Y(), p.Z()};
  });
  const CarriedNodes carried = carry(under(before, 1), under(after, 1), mesh);
  for (std::size_t i = 0; i < carried.nodes.size(); ++i) {
    const gp_Pnt p = after->Value(static_cast<double>(i % 13) / 12, static_cast<double>(i / 13) / 12);
    EXPECT_LT(distance(carried.places[i], {p.X(), p.Y(), p.Z()}), sewn) << i;
  }
}

TEST_F(CadMove, OtherStructuresAreRefusedByName) {
  const TopoDS_Shape hole =
      BRepAlgoAPI_Cut(box(1, 2, 3), BRepPrimAPI_MakeCylinder(gp_Ax2(gp_Pnt(0.5, 1, 0), gp::DZ()), 0.2, 3).Shape()).Shape();
  const std::string text = refusal(box(1, 2, 3), hole, box_mesh(1, 2, 3, 2));
  EXPECT_THAT(text, HasSubstr("differ in structure: 6 faces, 12 edges and 8 vertices became 7 faces, 15 edges and 10 vertices"));
  EXPECT_THAT(text, HasSubstr("face 7 (cylinder) of the new model has 1 loop of 4 edges in all and no partner"));
}

TEST_F(CadMove, FacesThatBecameSplinesAreFoundAndNamed) {
  const TopoDS_Shape before = box(1, 2, 3);
  const Mesh mesh = box_mesh(1, 2, 3, 4);
  const CarriedNodes carried = carry(before, BRepBuilderAPI_NurbsConvert(box(1.5, 2, 2.5), true).Shape(), mesh);
  for (std::size_t i = 0; i < carried.nodes.size(); ++i) {
    const Vec3& p = mesh.points[carried.nodes[i]];
    EXPECT_LT(distance(carried.places[i], {1.5 * p[0], p[1], p[2] / 1.2}), 1e-9) << i;
  }
  EXPECT_THAT(carried.notes,
              testing::Contains(HasSubstr("6 of 6 faces have another type in the new model, such as face 1 (plane), "
                                          "whose partner is face 1 (B-spline)")));
}

TEST_F(CadMove, OtherTypesAreNamedWithTheFacesOfTheFiles) {
  // A cone is no partner of a cylinder, though the structure is the same, and faces of the files are named, not merged ones.
  const auto bored = [](const TopoDS_Shape& tool) {
    const TopoDS_Shape split = BRepAlgoAPI_Fuse(box(1, 2, 3), BRepPrimAPI_MakeBox(gp_Pnt(1, 0, 0), 1, 2, 3).Shape()).Shape();
    return BRepAlgoAPI_Cut(split, tool).Shape();
  };
  const gp_Ax2 axis(gp_Pnt(0.5, 1, 0), gp::DZ());
  const std::string text = refusal(bored(BRepPrimAPI_MakeCylinder(axis, 0.2, 3).Shape()),
                                   bored(BRepPrimAPI_MakeCone(axis, 0.2, 0.3, 3).Shape()), box_mesh(2, 2, 3, 2));
  EXPECT_THAT(text, HasSubstr("differ in structure"));
  EXPECT_THAT(text, HasSubstr("(cylinder)"));
  EXPECT_THAT(text, HasSubstr("(cone)"));
}

/// A sheet of 4 x 3 and 1e-5 D, which becomes a block, with a mesh of few digits in which both sides are the same.
class CadSheets : public CadMove {
 protected:
  CadSheets() : mesh_(box_mesh(4, 3, thickness, n)) {
    for (Vec3& p : mesh_.points) p[2] = 0;
    request_.before = file(box(4, 3, thickness), "before");
    request_.after = file(box(4, 3, 0.5), "after");
    // Grids of the sides z, y, x at the origin, then of those opposite.
    for (int side = 0; side < 6; ++side) request_.face_entities.insert(request_.face_entities.end(), n * n, 10 + side);
    turn_outwards();
  }
  /// As the faces of the boundary of a volume: x runs before y on top, after it below.
  void turn_outwards() {
    for (std::size_t f = 0; f < mesh_.face_count(); ++f) {
      const std::size_t side = f / (n * n);
      if (side == 0 || side == 2 || side == 4)
        std::reverse(mesh_.face_points.begin() + 4 * f, mesh_.face_points.begin() + 4 * f + 4);
    }
  }
  /// How many nodes of the grids inside both sides are where they should be.
  std::size_t right(const CarriedNodes& carried) const {
    std::size_t count = 0;
    for (const int grid : {0, 3}) {
      for (int j = 1; j < n; ++j) {
        for (int i = 1; i < n; ++i) {
          const std::size_t node = static_cast<std::size_t>(grid * (n + 1) * (n + 1) + j * (n + 1) + i);
          const Vec3 &p = mesh_.points[node], &q = carried.places[node];
          count += distance(q, {p[0], p[1], grid == 0 ? 0 : 0.5}) < 1e-9 ? 1 : 0;
        }
      }
    }
    return count;
  }

  static constexpr int n = 6;
  static constexpr std::size_t inside = 2 * (n - 1) * (n - 1);
  static constexpr double thickness = 5e-5;
  Mesh mesh_;
  MoveRequest request_;
};

TEST_F(CadSheets, DistanceAloneDoesNotTellTheSides) {
  request_.face_entities.clear();
  EXPECT_LE(right(carry_nodes(mesh_, request_)), inside / 2);
}

TEST_F(CadSheets, EntitiesTellTheSidesWhateverTheirTags) {
  // The rims of the sheet are as flat as its digits allow: their nodes are put back for their entities to have an area.
  for (std::size_t k = 0; k < mesh_.points.size(); ++k) {
    const std::size_t grid = k / ((n + 1) * (n + 1)), row = k % ((n + 1) * (n + 1)) / (n + 1);
    if (grid % 3 != 0) mesh_.points[k][2] = thickness * static_cast<double>(row) / n;
  }
  EXPECT_EQ(right(carry_nodes(mesh_, request_)), inside);
  std::swap_ranges(request_.face_entities.begin(), request_.face_entities.begin() + n * n,
                   request_.face_entities.begin() + 3 * n * n);
  EXPECT_EQ(right(carry_nodes(mesh_, request_)), inside);
  // Turned inwards as a whole.
  for (std::size_t f = 0; f < mesh_.face_count(); ++f)
    std::reverse(mesh_.face_points.begin() + 4 * f, mesh_.face_points.begin() + 4 * f + 4);
  EXPECT_EQ(right(carry_nodes(mesh_, request_)), inside);
}

TEST_F(CadSheets, EntitiesOnSeveralFacesAreSaidAndNotUsed) {
  std::fill(request_.face_entities.begin(), request_.face_entities.end(), 1);
  const CarriedNodes carried = carry_nodes(mesh_, request_);
  EXPECT_LE(right(carried), inside / 2);
  EXPECT_THAT(carried.notes, testing::Contains(HasSubstr("1 of 1 entities and named groups of the mesh lie on no single face")));
  EXPECT_THAT(carried.notes, testing::Contains(HasSubstr("such as surface 1: ")));
}

TEST_F(CadMove, TwoWaysThatFitAlikeAreRefused) {
  gp_Trsf turn;
  turn.SetRotation(gp_Ax1(gp_Pnt(0.5, 0.5, 0), gp::DZ()), std::numbers::pi / 4);
  const TopoDS_Shape turned = BRepBuilderAPI_Transform(box(1, 1, 1), turn, true).Shape();
  EXPECT_THAT(refusal(box(1, 1, 1), turned, box_mesh(1, 1, 1, 2)), HasSubstr("ambiguous"));
}

TEST_F(CadMove, NodesOffTheModelAreNamed) {
  Mesh mesh = box_mesh(1, 2, 3, 2);
  mesh.points[4][2] += 0.1;
  EXPECT_THAT(refusal(box(1, 2, 3), box(1, 2, 3), mesh), HasSubstr("1 of 54 nodes"));
  EXPECT_THAT(refusal(box(1, 2, 3), box(1, 2, 3), mesh), HasSubstr("such as 4;"));
}

TEST_F(CadMove, TheDistanceOfTheNodesFromTheOldModelIsTold) {
  Mesh mesh = box_mesh(1, 2, 3, 2);
  EXPECT_LT(carry(box(1, 2, 3), box(1, 2, 4), mesh).farthest, 1e-12);
  mesh.points[4][2] += 1e-4;  // inside of a face, as the next one
  mesh.points[13][1] -= 2e-4;
  EXPECT_NEAR(carry(box(1, 2, 3), box(1, 2, 4), mesh).farthest, 2e-4, 1e-9);
}

TEST_F(CadMove, GivenPairsAreChecked) {
  EXPECT_THROW(carry(box(1, 2, 3), box(1, 2, 3), box_mesh(1, 2, 3, 2), {{ForcedPair::Kind::face, 7, 1}}), Error);
  EXPECT_NO_THROW(carry(box(1, 2, 3), box(1, 2, 3), box_mesh(1, 2, 3, 2), {{ForcedPair::Kind::face, 1, 1}}));
}

}  // namespace
}  // namespace deform::cad::cad_move_test
