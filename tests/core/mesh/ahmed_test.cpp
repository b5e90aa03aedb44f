// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/mesh/ahmed.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "core/mesh/inspect.h"
#include "tests/support/expect_error.h"

namespace deform::ahmed_test {
namespace {

constexpr double pi = std::numbers::pi;

Vec3 minus(const Vec3& a, const Vec3& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
Vec3 cross(const Vec3& a, const Vec3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
double dot(const Vec3& a, const Vec3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

std::array<Vec3, 3> corners(const Mesh& mesh, std::size_t face) {
  return {mesh.points[mesh.face_points[3 * face]], mesh.points[mesh.face_points[3 * face + 1]],
          mesh.points[mesh.face_points[3 * face + 2]]};
}

double volume(const Mesh& mesh) {
  double sum = 0;
  for (std::size_t f = 0; f < mesh.face_count(); ++f) {
    const auto [a, b, c] = corners(mesh, f);
    sum += dot(a, cross(b, c)) / 6;
  }
  return sum;
}

double smallest_angle_degrees(const Mesh& mesh) {
  double smallest = 180;
  for (std::size_t f = 0; f < mesh.face_count(); ++f) {
    const auto p = corners(mesh, f);
    for (int k = 0; k < 3; ++k) {
      const Vec3 u = minus(p[(k + 1) % 3], p[k]), v = minus(p[(k + 2) % 3], p[k]);
      smallest = std::min(smallest, std::acos(dot(u, v) / std::sqrt(dot(u, u) * dot(v, v))) * 180 / pi);
    }
  }
  return smallest;
}

/// The volume of the exact body: a box whose cross-section shrinks towards the nose by d(x) on all four sides, less the wedge
/// behind the slant, and four cylinders.
double exact_volume(double slant_degrees) {
  const double l = 1.044, w = 0.389, h = 0.288, r = 0.1, s = 0.222, angle = slant_degrees * pi / 180;
  const double inset = r * r * (1 - pi / 4);                    // integral of d over 0..r
  const double inset_squared = r * r * r * (5.0 / 3 - pi / 2);  // integral of d^2
  return l * w * h - 2 * (w + h) * inset + 4 * inset_squared - 0.5 * s * std::cos(angle) * s * std::sin(angle) * w +
         4 * pi * 0.015 * 0.015 * 0.05;
}

struct Case {
  double slant;
  std::size_t points;
};

std::ostream& operator<<(std::ostream& out, const Case& c) { return out << "slant " << c.slant << ", " << c.points << " points"; }

class AhmedTest : public testing::TestWithParam<Case> {
 protected:
  AhmedTest() : mesh_(ahmed_body({GetParam().slant, GetParam().points})) {}
  const Mesh mesh_;
};

TEST_P(AhmedTest, IsAClosedManifoldOutwardSurface) {
  ASSERT_NO_THROW(mesh_.validate());
  const MeshReport report = inspect(mesh_);
  EXPECT_EQ(report.triangles, report.faces);
  EXPECT_EQ(report.components, 1U);
  EXPECT_EQ(report.boundary_edges, 0U);
  EXPECT_EQ(report.non_manifold_edges, 0U);
  EXPECT_EQ(report.inconsistent_edges, 0U);
  EXPECT_EQ(report.non_manifold_points, 0U);
  EXPECT_EQ(report.degenerate_faces, 0U);
  EXPECT_EQ(report.isolated_points, 0U);
  EXPECT_EQ(report.coincident_points, 0U);
  EXPECT_EQ(report.points + report.faces, report.edges + 2);  // a sphere: stilts are bumps, not handles
}

TEST_P(AhmedTest, HasAboutTheAskedNumberOfPoints) {
  EXPECT_NEAR(static_cast<double>(mesh_.point_count()), static_cast<double>(GetParam().points), 0.03 * GetParam().points);
}

TEST_P(AhmedTest, HasTheMeasuresOfThePaper) {
  const Box box = bounding_box(mesh_.points);
  EXPECT_NEAR(box.min[0], 0, 1e-15);
  EXPECT_NEAR(box.max[0], 1.044, 1e-15);
  EXPECT_NEAR(box.max[1], 0.1945, 1e-15);
  EXPECT_EQ(box.min[1], -box.max[1]);
  EXPECT_EQ(box.min[2], 0);
  EXPECT_NEAR(box.max[2], 0.338, 1e-15);
  // Chords cut the rounded front and the stilts: the error falls with the square of the spacing.
  EXPECT_NEAR(volume(mesh_) / exact_volume(GetParam().slant), 1, 2.0 / static_cast<double>(GetParam().points));
}

TEST_P(AhmedTest, HasGoodTriangles) { EXPECT_GT(smallest_angle_degrees(mesh_), 17); }

TEST_P(AhmedTest, StiltsStandOnDiscsThatAreCoveredOnce) {
  double area = 0;
  for (std::size_t f = 0; f < mesh_.face_count(); ++f) {
    const auto [a, b, c] = corners(mesh_, f);
    if (a[2] != 0 || b[2] != 0 || c[2] != 0) continue;
    const double upwards = cross(minus(b, a), minus(c, a))[2] / 2;
    EXPECT_LT(upwards, 0) << "face " << f << " is folded over another one";
    area -= upwards;
  }
  // Polygons of 8 corners or more in circles of radius 0.015.
  EXPECT_LT(area, 4 * pi * 0.015 * 0.015);
  EXPECT_GT(area, 4 * 8 * 0.5 * 0.015 * 0.015 * std::sin(pi / 4) * (1 - 1e-12));
}

TEST_P(AhmedTest, EveryFaceIsInOneGroup) {
  std::vector<int> seen(mesh_.face_count(), 0);
  std::vector<std::string> names;
  for (const Group& group : mesh_.groups) {
    names.push_back(group.name);
    EXPECT_FALSE(group.faces.empty()) << group.name;
    EXPECT_TRUE(group.points.empty()) << group.name;
    for (const FaceId face : group.faces) ++seen[face];
  }
  EXPECT_THAT(names, testing::ElementsAre("nose", "roof", "sides", "slant", "base", "underbody", "stilts"));
  EXPECT_TRUE(std::all_of(seen.begin(), seen.end(), [](int count) { return count == 1; }));
}

TEST_P(AhmedTest, GroupsLieWhereTheirNamesSay) {
  const double angle = GetParam().slant * pi / 180;
  const double slant_start = 1.044 - 0.222 * std::cos(angle);
  const std::map<std::string, std::function<bool(const Vec3&)>> inside = {
      {"nose", [](const Vec3& p) { return p[0] <= 0.1 + 1e-12 && p[2] >= 0.05 - 1e-12; }},
      {"roof", [&](const Vec3& p) { return std::abs(p[2] - 0.338) < 1e-12 && p[0] <= slant_start + 1e-12; }},
      {"sides", [](const Vec3& p) { return std::abs(std::abs(p[1]) - 0.1945) < 1e-12 && p[0] >= 0.1 - 1e-12; }},
      {"slant", [&](const Vec3& p) { return std::abs(p[2] - (0.338 - (p[0] - slant_start) * std::tan(angle))) < 1e-12; }},
      {"base", [](const Vec3& p) { return p[0] == 1.044; }},
      {"underbody", [](const Vec3& p) { return std::abs(p[2] - 0.05) < 1e-12 && p[0] >= 0.1 - 1e-12; }},
      {"stilts", [](const Vec3& p) {
         const double x = std::min(std::abs(p[0] - 0.202), std::abs(p[0] - 0.672));
         return p[2] <= 0.05 && std::hypot(x, std::abs(p[1]) - 0.1635) <= 0.015 + 1e-12;
       }}};
  for (const Group& group : mesh_.groups) {
    for (const FaceId face : group.faces) {
      for (const Vec3& p : corners(mesh_, face)) {
        ASSERT_TRUE(inside.at(group.name)(p)) << group.name << " at " << p[0] << " " << p[1] << " " << p[2];
      }
    }
  }
}

TEST_P(AhmedTest, IsItsOwnMirrorImage) {
  std::map<Vec3, PointId> ids;
  for (std::size_t i = 0; i < mesh_.point_count(); ++i) ids[mesh_.points[i]] = static_cast<PointId>(i);
  std::vector<std::array<PointId, 3>> faces, images;
  for (std::size_t f = 0; f < mesh_.face_count(); ++f) {
    std::array<PointId, 3> face, image;
    for (int k = 0; k < 3; ++k) {
      face[k] = mesh_.face_points[3 * f + k];
      const Vec3& p = mesh_.points[face[k]];
      const auto found = ids.find({p[0], p[1] == 0 ? 0 : -p[1], p[2]});
      ASSERT_NE(found, ids.end());
      image[2 - k] = found->second;
    }
    std::rotate(face.begin(), std::min_element(face.begin(), face.end()), face.end());
    std::rotate(image.begin(), std::min_element(image.begin(), image.end()), image.end());
    faces.push_back(face);
    images.push_back(image);
  }
  std::sort(faces.begin(), faces.end());
  std::sort(images.begin(), images.end());
  EXPECT_EQ(faces, images);
}

TEST_P(AhmedTest, IsTheSameEveryTime) {
  const Mesh again = ahmed_body({GetParam().slant, GetParam().points});
  EXPECT_EQ(again.points, mesh_.points);
  EXPECT_EQ(again.face_points, mesh_.face_points);
}

std::string name_of(const testing::TestParamInfo<Case>& tested) {
  return "slant_" + std::to_string(std::lround(10 * tested.param.slant)) + "_points_" + std::to_string(tested.param.points);
}

INSTANTIATE_TEST_SUITE_P(Small, AhmedTest,
                         testing::Values(Case{0, 2000}, Case{12.5, 2000}, Case{25, 2000}, Case{35, 2000}, Case{40, 2000},
                                         Case{25, 3000}, Case{25, 5000}, Case{0, 10000}, Case{12.5, 10000}, Case{25, 10000},
                                         Case{35, 10000}, Case{40, 10000}),
                         name_of);
INSTANTIATE_TEST_SUITE_P(Large, AhmedTest, testing::Values(Case{0, 100000}, Case{25, 100000}, Case{40, 100000}, Case{25, 500000}),
                         name_of);

TEST(AhmedOptionsTest, EveryTargetIsMet) {
  for (double target = 2000; target < 60000; target *= 1.07) {
    const auto points = static_cast<std::size_t>(target);
    for (const double slant : {0.0, 30.0}) {
      const double made = static_cast<double>(ahmed_body({slant, points}).point_count());
      EXPECT_NEAR(made / target, 1, 0.1) << points << " points, slant " << slant;
    }
  }
}

TEST(AhmedOptionsTest, ValuesOutsideTheirRangeAreRefused) {
  const auto expect_refused = [](const AhmedOptions& options, const std::vector<const char*>& parts) {
    test::expect_error(ErrorCode::invalid_argument, parts, [&] { ahmed_body(options); });
  };
  expect_refused({-1, 10000}, {"slant_degrees", "-1", "0..40"});
  expect_refused({40.1, 10000}, {"slant_degrees", "40.1"});
  expect_refused({std::nan(""), 10000}, {"slant_degrees", "nan"});
  expect_refused({25, 1999}, {"target_points", "1999", "2000..2000000"});
  expect_refused({25, 2000001}, {"target_points", "2000001"});
}

}  // namespace
}  // namespace deform::ahmed_test
