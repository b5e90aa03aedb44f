// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/cad_regions.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <BRepAlgoAPI_Cut.hxx>
#include <BRepAlgoAPI_Fuse.hxx>
#include <BRepBuilderAPI_MakeFace.hxx>
#include <BRepPrimAPI_MakeBox.hxx>
#include <BRepPrimAPI_MakeCone.hxx>
#include <BRepPrimAPI_MakeCylinder.hxx>
#include <BRepPrimAPI_MakeSphere.hxx>
#include <BRepTools.hxx>
#include <cmath>
#include <filesystem>
#include <functional>
#include <gp_Pln.hxx>
#include <numbers>

#include "core/base/error.h"
#include "core/base/vectors.h"

namespace deform::cad::cad_regions_test {
namespace {

using Kind = CadShape::Kind;
using testing::HasSubstr;

/// A grid of n x m quadrilaterals.
void add_patch(Mesh& mesh, int n, int m, const std::function<Vec3(double, double)>& place) {
  const auto first = static_cast<PointId>(mesh.points.size());
  for (int j = 0; j <= m; ++j) {
    for (int i = 0; i <= n; ++i) mesh.points.push_back(place(static_cast<double>(i) / n, static_cast<double>(j) / m));
  }
  for (int j = 0; j < m; ++j) {
    for (int i = 0; i < n; ++i) {
      const PointId p = first + static_cast<PointId>(i + j * (n + 1));
      mesh.face_sizes.push_back(4);
      for (const PointId q : {p, p + 1, p + n + 2, p + n + 1}) mesh.face_points.push_back(q);
    }
  }
}

Mesh box_mesh(double x, double y, double z) {
  Mesh mesh;
  for (const double s : {0.0, 1.0}) {
    add_patch(mesh, 6, 5, [&](double a, double b) { return Vec3{a * x, b * y, s * z}; });
    add_patch(mesh, 6, 4, [&](double a, double b) { return Vec3{a * x, s * y, b * z}; });
    add_patch(mesh, 5, 4, [&](double a, double b) { return Vec3{s * x, a * y, b * z}; });
  }
  return mesh;
}

std::vector<PointId> points_where(const Mesh& mesh, const std::function<bool(const Vec3&)>& holds) {
  std::vector<PointId> points;
  for (PointId p = 0; p < mesh.point_count(); ++p) {
    if (holds(mesh.points[p])) points.push_back(p);
  }
  return points;
}

class CadRegionsTest : public testing::Test {
 protected:
  CadRegions find(const TopoDS_Shape& shape, const Mesh& mesh, double scale = 1) {
    const auto* test = testing::UnitTest::GetInstance()->current_test_info();
    path_ = std::filesystem::temp_directory_path() / ("deform_regions_" + std::string(test->name()) + ".brep");
    BRepTools::Write(shape, path_.c_str());
    RegionsRequest request;
    request.model = path_;
    request.scale = scale;
    return cad_regions(mesh, request);
  }
  void TearDown() override { std::filesystem::remove(path_); }

 private:
  std::filesystem::path path_;
};

TEST_F(CadRegionsTest, TheSidesAndEdgesOfABoxHoldTheirPoints) {
  const Mesh mesh = box_mesh(1, 2, 3);
  const CadRegions regions = find(BRepPrimAPI_MakeBox(10, 20, 30).Shape(), mesh, 0.1);
  ASSERT_EQ(regions.faces.size(), 6u);
  ASSERT_EQ(regions.edges.size(), 12u);
  for (const CadShape& face : regions.faces) {
    EXPECT_EQ(face.kind, Kind::plane);
    EXPECT_EQ(face.name, "plane_" + std::to_string(face.numbers.at(0)));
    EXPECT_EQ(face.points, points_where(mesh, [&](const Vec3& p) { return std::abs(dot(p - face.point, face.axis)) < 1e-9; }));
    EXPECT_LT(face.largest, 1e-12);
  }
  for (const CadShape& edge : regions.edges) {
    EXPECT_EQ(edge.kind, Kind::line);
    EXPECT_EQ(edge.lies_on.size(), 2u);
    EXPECT_EQ(edge.points, points_where(mesh, [&](const Vec3& p) { return norm(cross(p - edge.point, edge.axis)) < 1e-9; }));
  }
  EXPECT_NEAR(regions.area, 22, 1e-9);
  ASSERT_EQ(regions.mirrors.size(), 3u);
  for (int k = 0; k < 3; ++k) {
    EXPECT_NEAR(std::abs(regions.mirrors[k].normal[k]), 1, 1e-9);
    EXPECT_NEAR(regions.mirrors[k].point[k], 0.5 * (k + 1), 1e-6);
  }
}

TEST_F(CadRegionsTest, HalvesOfACylinderAreOneShapeWithItsRadiusAndCircles) {
  const TopoDS_Shape half = BRepPrimAPI_MakeCylinder(gp_Ax2(gp::Origin(), gp::DZ(), gp::DX()), 0.5, 2, std::numbers::pi).Shape();
  const TopoDS_Shape other =
      BRepPrimAPI_MakeCylinder(gp_Ax2(gp::Origin(), gp::DZ(), gp_Dir(-1, 0, 0)), 0.5, 2, std::numbers::pi).Shape();
  Mesh mesh;
  add_patch(mesh, 16, 5, [](double a, double b) {
    const double angle = 2 * std::numbers::pi * a;
    return Vec3{0.5 * std::cos(angle), 0.5 * std::sin(angle), 2 * b};
  });
  const CadRegions regions = find(BRepAlgoAPI_Fuse(half, other).Shape(), mesh);
  int cylinders = 0, circles = 0;
  for (const CadShape& face : regions.faces) {
    if (face.kind != Kind::cylinder) continue;
    ++cylinders;
    EXPECT_EQ(face.numbers.size(), 2u);
    EXPECT_NEAR(face.radius, 0.5, 1e-12);
    EXPECT_NEAR(std::abs(face.axis[2]), 1, 1e-12);
    EXPECT_EQ(face.points.size(), mesh.point_count());
    EXPECT_LT(face.largest, 1e-12);
    EXPECT_NEAR(face.size, 2 * std::numbers::pi, 1e-6);
  }
  for (const CadShape& edge : regions.edges) {
    for (const int f : edge.lies_on) EXPECT_LT(f, static_cast<int>(regions.faces.size()));
    if (edge.kind == Kind::circle) {
      ++circles;
      EXPECT_NEAR(edge.radius, 0.5, 1e-12);
      EXPECT_EQ(edge.type, "arc");
      EXPECT_NEAR(edge.size, 0.5 * std::numbers::pi, 1e-9);
      EXPECT_EQ(edge.points.size(), 10u) << "half of a row, whose first and last point coincide";
      EXPECT_LT(edge.largest, 1e-12);
    }
    EXPECT_EQ(edge.lies_on.size(), 2u) << "edges between the halves are no edges of the shape";
  }
  EXPECT_EQ(cylinders, 1);
  EXPECT_EQ(circles, 4) << "two arcs at each end";
}

TEST_F(CadRegionsTest, ConesAndSpheresHaveTheirParameters) {
  Mesh cone;
  const double tangent = std::tan(0.3);
  add_patch(cone, 12, 4, [&](double a, double b) {
    const double angle = 2 * std::numbers::pi * a, z = 1 + b;
    return Vec3{tangent * z * std::cos(angle), tangent * z * std::sin(angle), z};
  });
  const gp_Ax2 place(gp_Pnt(0, 0, 1), gp::DZ());
  for (const CadShape& face : find(BRepPrimAPI_MakeCone(place, tangent, 2 * tangent, 1).Shape(), cone).faces) {
    if (face.kind != Kind::cone) continue;
    EXPECT_NEAR(face.half_angle, 0.3, 1e-9);
    EXPECT_LT(norm(face.point), 1e-9);
    EXPECT_NEAR(face.axis[2], 1, 1e-9);
    EXPECT_EQ(face.points.size(), cone.point_count());
    EXPECT_LT(face.largest, 1e-9);
  }
  Mesh ball;
  add_patch(ball, 12, 6, [](double a, double b) {
    const double angle = 2 * std::numbers::pi * a, height = std::numbers::pi * (b - 0.5);
    return Vec3{1 + 2 * std::cos(height) * std::cos(angle), 2 * std::cos(height) * std::sin(angle), 2 * std::sin(height)};
  });
  const CadRegions regions = find(BRepPrimAPI_MakeSphere(gp_Pnt(1, 0, 0), 2).Shape(), ball);
  ASSERT_EQ(regions.faces.size(), 1u);
  EXPECT_EQ(regions.faces[0].kind, Kind::sphere);
  EXPECT_NEAR(regions.faces[0].radius, 2, 1e-12);
  EXPECT_EQ(regions.faces[0].points.size(), ball.point_count());
  EXPECT_TRUE(regions.edges.empty()) << "seam and poles are no edges";
  EXPECT_GE(regions.mirrors.size(), 3u);
}

/// How many of the shapes are of the kind, and of how many faces of the model each of these is.
std::vector<std::size_t> faces_of(const CadRegions& regions, Kind kind) {
  std::vector<std::size_t> numbers;
  for (const CadShape& face : regions.faces) {
    if (face.kind == kind) numbers.push_back(face.numbers.size());
  }
  return numbers;
}

TEST_F(CadRegionsTest, HalvesOfAConeOrSphereAreOneShape) {
  const gp_Ax2 here(gp::Origin(), gp::DZ(), gp::DX()), opposite(gp::Origin(), gp::DZ(), gp_Dir(-1, 0, 0));
  const double pi = std::numbers::pi;
  Mesh cone;
  add_patch(cone, 12, 4, [&](double a, double b) {
    const double angle = 2 * pi * a, radius = 1 - 0.6 * b;
    return Vec3{radius * std::cos(angle), radius * std::sin(angle), 2 * b};
  });
  const TopoDS_Shape halves =
      BRepAlgoAPI_Fuse(BRepPrimAPI_MakeCone(here, 1, 0.4, 2, pi).Shape(), BRepPrimAPI_MakeCone(opposite, 1, 0.4, 2, pi).Shape());
  const CadRegions of_cone = find(halves, cone);
  EXPECT_THAT(faces_of(of_cone, Kind::cone), testing::ElementsAre(2));
  for (const CadShape& face : of_cone.faces) {
    if (face.kind == Kind::cone) {
      EXPECT_EQ(face.points.size(), cone.point_count());
    }
  }
  Mesh ball;
  add_patch(ball, 12, 6, [&](double a, double b) {
    const double angle = 2 * pi * a, height = pi * (b - 0.5);
    return Vec3{std::cos(height) * std::cos(angle), std::cos(height) * std::sin(angle), std::sin(height)};
  });
  const CadRegions of_ball =
      find(BRepAlgoAPI_Fuse(BRepPrimAPI_MakeSphere(here, 1, pi).Shape(), BRepPrimAPI_MakeSphere(opposite, 1, pi).Shape()), ball);
  EXPECT_THAT(faces_of(of_ball, Kind::sphere), testing::ElementsAre(2));
  EXPECT_EQ(of_ball.faces.at(0).points.size(), ball.point_count());
}

TEST_F(CadRegionsTest, ConesOrSpheresThatMeetInACircleAreTwo) {
  Mesh rim;  // where they meet
  add_patch(rim, 12, 1, [](double a, double b) {
    const double angle = 2 * std::numbers::pi * a, radius = 1 - 0.6 * b;
    return Vec3{radius * std::cos(angle), radius * std::sin(angle), b};
  });
  const gp_Ax2 up(gp::Origin(), gp::DZ()), down(gp::Origin(), gp_Dir(0, 0, -1));
  const CadRegions cones =
      find(BRepAlgoAPI_Fuse(BRepPrimAPI_MakeCone(up, 1, 0.4, 1).Shape(), BRepPrimAPI_MakeCone(down, 1, 0.4, 1).Shape()), rim);
  EXPECT_THAT(faces_of(cones, Kind::cone), testing::ElementsAre(1, 1));
  Mesh poles;
  add_patch(poles, 1, 1, [](double, double b) { return Vec3{0, 0, b == 0 ? -1 : 2}; });
  const CadRegions balls = find(BRepAlgoAPI_Fuse(BRepPrimAPI_MakeSphere(gp_Pnt(0, 0, 0), 1).Shape(),
                                                 BRepPrimAPI_MakeSphere(gp_Pnt(0, 0, 1.2), 0.8).Shape()),
                                poles);
  EXPECT_THAT(faces_of(balls, Kind::sphere), testing::ElementsAre(1, 1));
}

TEST_F(CadRegionsTest, TheDistanceOfTheNodesFromTheModelIsTold) {
  Mesh mesh = box_mesh(1, 2, 3);
  EXPECT_LT(find(BRepPrimAPI_MakeBox(1, 2, 3).Shape(), mesh).farthest, 1e-12);
  mesh.points[9][2] += 1e-4;  // inside of a face, as the next one
  mesh.points[10][2] -= 2e-4;
  EXPECT_NEAR(find(BRepPrimAPI_MakeBox(1, 2, 3).Shape(), mesh).farthest, 2e-4, 1e-9);
}

TEST_F(CadRegionsTest, EdgesOfOneFaceAreEdgesOfTheShape) {
  // One face uses them once; seams are used twice.
  Mesh mesh;
  add_patch(mesh, 6, 5, [](double a, double b) { return Vec3{4 * a, 3 * b, 0}; });
  const CadRegions regions = find(BRepBuilderAPI_MakeFace(gp_Pln(gp::Origin(), gp::DZ()), 0, 4, 0, 3).Shape(), mesh);
  ASSERT_EQ(regions.faces.size(), 1u);
  EXPECT_EQ(regions.faces[0].points.size(), mesh.point_count());
  ASSERT_EQ(regions.edges.size(), 4u);
  for (const CadShape& edge : regions.edges) {
    EXPECT_EQ(edge.lies_on, std::vector<int>{0});
    EXPECT_EQ(edge.points, points_where(mesh, [&](const Vec3& p) { return norm(cross(p - edge.point, edge.axis)) < 1e-9; }));
  }
}

TEST_F(CadRegionsTest, AnEccentricBoreLeavesTheMirrorsThatItMeets) {
  const TopoDS_Shape block = BRepAlgoAPI_Cut(BRepPrimAPI_MakeBox(1, 2, 3).Shape(),
                                             BRepPrimAPI_MakeCylinder(gp_Ax2(gp_Pnt(0.5, 1.4, 0), gp::DZ()), 0.2, 3).Shape());
  const CadRegions regions = find(block, box_mesh(1, 2, 3));
  ASSERT_EQ(regions.mirrors.size(), 2u);
  EXPECT_NEAR(std::abs(regions.mirrors[0].normal[0]), 1, 1e-9);
  EXPECT_NEAR(std::abs(regions.mirrors[1].normal[2]), 1, 1e-9);
}

TEST_F(CadRegionsTest, NodesOffTheModelAreNamed) {
  Mesh mesh = box_mesh(1, 2, 3);
  mesh.points[9][2] += 0.1;  // inside of a face
  try {
    find(BRepPrimAPI_MakeBox(1, 2, 3).Shape(), mesh);
    FAIL();
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("such as 9;"));
  }
}

}  // namespace
}  // namespace deform::cad::cad_regions_test
