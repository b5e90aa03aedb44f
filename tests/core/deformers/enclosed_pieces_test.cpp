// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/spaces/enclosed_pieces.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "core/base/vectors.h"
#include "core/deformers/energy/spaces/mesh_pieces.h"
#include "tests/core/quality/surface_meshes.h"

namespace deform::enclosed_pieces_test {
namespace {

EnclosedPieces enclosed(const Mesh& mesh) {
  return {mesh, mesh.points, sample_uniformly(FacePieces(mesh, mesh.points), 3000, 1).points, 1};
}

double volume(const EnclosedPieces& pieces) {
  double sum = 0;
  for (std::size_t i = 0; i < pieces.count(); ++i) sum += pieces.measure(i);
  return sum;
}

TEST(EnclosedPieces, FillASphereAndNothingElse) {
  const Mesh mesh = test::sphere(1, 5);
  const EnclosedPieces pieces = enclosed(mesh);
  EXPECT_EQ(pieces.enclosing_area(), 1);
  EXPECT_NEAR(volume(pieces), 4 * std::numbers::pi / 3, 0.03);
  for (const Vec3& x : sample_uniformly(pieces, 5000, 2).points) EXPECT_LT(length(x), 1);
}

TEST(EnclosedPieces, AThinShellBetweenTwoSpheres) {
  Mesh mesh = test::sphere(1, 5);
  const Mesh hollow = test::sphere(0.98, 5);
  const auto count = static_cast<PointId>(mesh.points.size());
  mesh.points.insert(mesh.points.end(), hollow.points.begin(), hollow.points.end());
  for (std::size_t f = 0; f < hollow.face_count(); ++f) {
    const PointId* const corners = hollow.face_points.data() + 3 * f;
    test::add_face(mesh, {corners[0] + count, corners[2] + count, corners[1] + count});
  }
  const EnclosedPieces pieces = enclosed(mesh);
  EXPECT_NEAR(volume(pieces) / (4 * std::numbers::pi / 3 * (1 - std::pow(0.98, 3))), 1, 0.05);
  for (const Vec3& x : sample_uniformly(pieces, 5000, 2).points) {
    EXPECT_LT(length(x), 1);
    EXPECT_GT(length(x), 0.97);  // the flat faces of the inner sphere
  }
}

TEST(EnclosedPieces, SmallHolesDoNoHarm) {
  Mesh mesh = test::sphere(1, 5);
  for (std::size_t f = 0; f < mesh.face_count(); f += 400) {  // twenty faces without area
    for (std::size_t i = 0; i < 3; ++i) mesh.face_points[3 * f + i] = mesh.face_points[3 * f];
  }
  const EnclosedPieces pieces = enclosed(mesh);
  EXPECT_GT(pieces.enclosing_area(), 0.9);
  EXPECT_NEAR(volume(pieces), 4 * std::numbers::pi / 3, 0.04);
}

TEST(EnclosedPieces, FacesThatAllFaceInwardsEncloseToo) {
  Mesh mesh = test::sphere(1, 4);
  for (std::size_t f = 0; f < mesh.face_count(); ++f) std::swap(mesh.face_points[3 * f], mesh.face_points[3 * f + 1]);
  EXPECT_NEAR(volume(enclosed(mesh)), 4 * std::numbers::pi / 3, 0.06);
}

TEST(EnclosedPieces, BowlsTubesSheetsAndFacesThatDisagreeEncloseNothing) {
  Mesh bowl = test::sphere(1, 4), torn = bowl;
  Mesh half;
  half.points = bowl.points;
  for (std::size_t f = 0; f < bowl.face_count(); ++f) {
    const PointId* const corners = bowl.face_points.data() + 3 * f;
    const double height = bowl.points[corners[0]][2] + bowl.points[corners[1]][2] + bowl.points[corners[2]][2];
    if (height < 0) test::add_face(half, {corners[0], corners[1], corners[2]});
    if (f % 2 == 0) std::swap(torn.face_points[3 * f], torn.face_points[3 * f + 1]);
  }
  const Mesh sheet = test::sheet(20, 20, test::Faces::quads, [](unsigned i, unsigned j) {
    return Vec3{0.1 * i, 0.1 * j, 0.1 * std::sin(0.4 * i)};
  });
  for (const Mesh& mesh : {half, torn, sheet, test::tube(0.5, 40, 40, 1, test::Faces::quads)})
    EXPECT_EQ(enclosed(mesh).count(), 0u);
}

}  // namespace
}  // namespace deform::enclosed_pieces_test
