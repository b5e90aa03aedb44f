// SPDX-License-Identifier: GPL-3.0-or-later
// Designs of meshes whose measures are known by hand, by the names of `deform quality`.
#include "core/quality/mesh_quality.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <set>

#include "core/base/vectors.h"
#include "core/mesh/elements.h"
#include "core/quality/safe_amplitude.h"
#include "tests/core/quality/cell_shapes.h"
#include "tests/core/quality/surface_meshes.h"
#include "tests/support/expect_error.h"

namespace deform::mesh_quality_test {
namespace {

using test::expect_error;

/// A cube of edge `edge` of n^3 hexahedra with its boundary; the faces at z = 0 are the group "floor".
std::shared_ptr<const Mesh> cube(std::uint32_t n, double edge) {
  auto mesh = std::make_shared<Mesh>();
  auto elements = std::make_shared<Elements>();
  const auto id = [&](std::uint32_t i, std::uint32_t j, std::uint32_t k) { return i + (n + 1) * (j + (n + 1) * k); };
  for (std::uint32_t k = 0; k <= n; ++k) {
    for (std::uint32_t j = 0; j <= n; ++j) {
      for (std::uint32_t i = 0; i <= n; ++i) mesh->points.push_back({edge * i / n, edge * j / n, edge * k / n});
    }
  }
  for (std::uint32_t k = 0; k < n; ++k) {
    for (std::uint32_t j = 0; j < n; ++j) {
      for (std::uint32_t i = 0; i < n; ++i) {
        const std::uint32_t nodes[] = {id(i, j, k),     id(i + 1, j, k),     id(i + 1, j + 1, k),     id(i, j + 1, k),
                                       id(i, j, k + 1), id(i + 1, j, k + 1), id(i + 1, j + 1, k + 1), id(i, j + 1, k + 1)};
        elements->add(ElementType::hexahedron, nodes);
      }
    }
  }
  BoundaryFaces boundary = boundary_faces(*elements);
  mesh->face_sizes = std::move(boundary.sizes);
  mesh->face_points = std::move(boundary.points);
  mesh->elements = elements;
  Group floor{"floor", {}, {}};
  for (std::size_t f = 0; f < mesh->face_count(); ++f) {
    const auto corners = std::span(mesh->face_points).subspan(4 * f, 4);
    if (std::all_of(corners.begin(), corners.end(), [&](PointId p) { return mesh->points[p][2] == 0; })) {
      floor.faces.push_back(static_cast<FaceId>(f));
    }
  }
  mesh->groups = {floor, {"lone", {0}, {}}};
  mesh->validate();
  return mesh;
}

/// A square of edge `edge` in the plane z = 0, of n x n squares.
std::shared_ptr<const Mesh> square(std::uint32_t n, double edge) {
  auto mesh = std::make_shared<Mesh>();
  for (std::uint32_t j = 0; j <= n; ++j) {
    for (std::uint32_t i = 0; i <= n; ++i) mesh->points.push_back({edge * i / n, edge * j / n, 0});
  }
  for (std::uint32_t j = 0; j < n; ++j) {
    for (std::uint32_t i = 0; i < n; ++i) {
      const std::uint32_t a = i + (n + 1) * j;
      mesh->face_sizes.push_back(4);
      for (const std::uint32_t p : {a, a + 1, a + n + 2, a + n + 1}) mesh->face_points.push_back(p);
    }
  }
  return mesh;
}

/// Points moved by `move`.
template <typename Move>
Points moved(const Mesh& mesh, const Move& move) {
  Points points = mesh.points;
  for (Vec3& p : points) p = move(p);
  return points;
}

double value_of(const QualityCheck& check, std::span<const Vec3> points, const std::string& name) {
  return check.values(points, {name}).at(0);
}

class InUnits : public testing::TestWithParam<std::tuple<std::uint32_t, double>> {};

TEST_P(InUnits, AShearedAndStretchedCubeHasKnownMeasures) {
  const auto [n, edge] = GetParam();
  const auto mesh = cube(n, edge);
  const QualityCheck check(mesh, {"floor"});
  const double shear = 0.5, stretch = 2;  // x by the height, heights twice
  const Points points = moved(*mesh, [&](const Vec3& p) { return Vec3{p[0] + shear * stretch * p[2], p[1], stretch * p[2]}; });
  const double cell = edge / n;
  const std::vector<double> found = check.values(points, {"wall_height", "scaled_jacobian", "volume", "total_volume",
                                                          "displacement", "flipped_faces", "inverted_cells", "wall_angle"});
  EXPECT_NEAR(found[0], stretch * cell, 1e-12 * edge);
  EXPECT_NEAR(found[1], 1 / std::sqrt(1 + shear * shear), 1e-12);
  EXPECT_NEAR(found[2], stretch * cell * cell * cell, 1e-12 * edge * edge * edge);
  EXPECT_NEAR(found[3], stretch * edge * edge * edge, 1e-12 * edge * edge * edge);
  EXPECT_NEAR(found[4], edge * std::hypot(shear * stretch, stretch - 1), 1e-12 * edge);
  EXPECT_EQ(found[5], 0);
  EXPECT_EQ(found[6], 0);
  EXPECT_NEAR(found[7], std::atan(shear) * 180 / std::acos(-1), 1e-9);
  const QualityReport report = check.report(points);
  for (const QualityCheck::Name& name : check.names()) {
    ASSERT_NE(report.find(name.name), nullptr) << name.name;
    const double alone = value_of(check, points, name.name);
    EXPECT_EQ(report.find(name.name)->value, alone) << name.name;
  }
}

INSTANTIATE_TEST_SUITE_P(Quality, InUnits, testing::Combine(testing::Values(2u, 5u), testing::Values(1.0, 1000.0, 1e-3)));

TEST(QualityCheck, CountsWhatIsInvertedAndFlippedAgainstTheRest) {
  const auto mesh = cube(3, 1);
  const QualityCheck check(mesh);
  Points points = mesh->points;
  points[0] = {2, 2, 2};  // its corner cell is turned inside out
  const QualityReport report = quality_report(element_quality(points, *mesh->elements), points, *mesh->elements);
  EXPECT_EQ(value_of(check, points, "inverted_cells"), report.find("inverted_elements")->value);
  EXPECT_GE(value_of(check, points, "inverted_cells"), 1);
  EXPECT_EQ(value_of(check, points, "aspect_ratio"), std::numeric_limits<double>::infinity());
  EXPECT_EQ(value_of(check, points, "flipped_faces"), static_cast<double>(FlipCheck(*mesh, mesh->points).flipped(points).size()));
  EXPECT_GE(value_of(check, points, "flipped_faces"), 1);
  const auto appeared = IntersectionCheck(*mesh, mesh->points).appeared(points);
  EXPECT_EQ(value_of(check, points, "newly_intersecting_faces"), static_cast<double>(appeared.size()));
  EXPECT_GE(appeared.size(), 2U);
  expect_error(ErrorCode::invalid_argument, {"intersecting_faces"}, [&] { check.check("intersecting_faces"); });  // of surfaces
}

TEST(QualityCheck, CountsFacesOfSurfacesThatIntersectOthersAtRestAndSince) {
  // Three sheets; the second crosses the first at rest, the third does so after the motion.
  auto mesh = std::make_shared<Mesh>();
  for (const double height : {0.0, -0.95, 0.3}) {
    const auto first = static_cast<PointId>(mesh->point_count());
    const Mesh sheet = test::sheet(8, 8, test::Faces::quads, [&](auto i, auto j) {
      return height == 0 ? Vec3{1.0 * i, 1.0 * j, 0} : Vec3{1.0 * i, 1.0 * j, height + 0.4 * i};
    });
    mesh->points.insert(mesh->points.end(), sheet.points.begin(), sheet.points.end());
    mesh->face_sizes.insert(mesh->face_sizes.end(), sheet.face_sizes.begin(), sheet.face_sizes.end());
    for (const PointId point : sheet.face_points) mesh->face_points.push_back(first + point);
  }
  const QualityCheck check(mesh);
  EXPECT_EQ(value_of(check, mesh->points, "intersecting_faces"), 16);
  EXPECT_EQ(value_of(check, mesh->points, "newly_intersecting_faces"), 0);
  Points points = mesh->points;
  for (std::size_t i = 162; i < 243; ++i) points[i][2] -= 2.4;  // at x = 5.25
  EXPECT_EQ(value_of(check, points, "intersecting_faces"), 32);
  EXPECT_EQ(value_of(check, points, "newly_intersecting_faces"), 16);
}

// A mesh that is left-handed at rest is measured as in a mirror; one that a design mirrored is inverted.
TEST(QualityCheck, KnowsHandednessFromTheRest) {
  const auto right = cube(3, 1);
  auto left = std::make_shared<Mesh>(*right);
  for (Vec3& p : left->points) p[0] = -p[0];
  EXPECT_EQ(value_of(QualityCheck(left), left->points, "inverted_elements"), 0);
  EXPECT_NEAR(value_of(QualityCheck(left), left->points, "scaled_jacobian"), 1, 1e-12);
  EXPECT_EQ(value_of(QualityCheck(right), left->points, "inverted_elements"), 27);
}

TEST(QualityCheck, MeasuresSurfacesPlanesAndPolyhedra) {
  const auto flat = square(4, 1000);
  const QualityCheck plane(flat);
  const Points sheared = moved(*flat, [](const Vec3& p) { return Vec3{p[0] + p[1], p[1], p[2]}; });
  EXPECT_NEAR(value_of(plane, sheared, "scaled_jacobian"), std::sqrt(0.5), 1e-12);
  EXPECT_NEAR(value_of(plane, sheared, "skewness"), 0.5, 1e-9);
  EXPECT_NEAR(value_of(plane, sheared, "least_angle"), 45, 1e-9);
  const Points lifted = moved(*flat, [](const Vec3& p) { return Vec3{p[0], p[1], p[0]}; });
  EXPECT_NEAR(value_of(plane, lifted, "total_area"), std::sqrt(2) * 1e6, 1e-6);
  expect_error(ErrorCode::invalid_argument, {"scaled_jacobian", "plane"}, [&] { value_of(plane, lifted, "scaled_jacobian"); });

  const test::Grid g = test::grid(3, 2, 2);
  auto polyhedra = std::make_shared<Mesh>();
  polyhedra->points = g.points;
  polyhedra->cells = std::make_shared<PolyhedralCells>(g.cells);
  const QualityCheck cells(polyhedra);
  const Points slanted = moved(*polyhedra, [](const Vec3& p) { return Vec3{p[0] + p[2], p[1], p[2]}; });
  EXPECT_NEAR(value_of(cells, slanted, "non_orthogonality"), 45, 1e-9);
  EXPECT_NEAR(value_of(cells, slanted, "volume"), 1, 1e-12);
  expect_error(ErrorCode::invalid_argument, {"flipped_faces"}, [&] { cells.check("flipped_faces"); });  // it has no faces
}

/// Measures are powers of lengths: in a unit of any size within the limits of coordinates they are the same digits.
TEST(QualityCheck, MeasuresUpToTheLimitsOfCoordinates) {
  const test::Grid g = test::grid(4, 3, 3);
  auto polyhedra = std::make_shared<Mesh>();
  polyhedra->points = g.points;
  polyhedra->cells = std::make_shared<PolyhedralCells>(g.cells);
  const auto tube = std::make_shared<const Mesh>(test::tube(1, 12, 8, 2, test::Faces::quads));
  std::mt19937_64 random(3);
  for (const auto& mesh : {cube(4, 1), square(5, 1), tube, std::shared_ptr<const Mesh>(polyhedra)}) {
    const bool plane = mesh->points.size() == 36;
    Points to = test::shaken(mesh->points, 0.3 / (mesh == polyhedra ? 1 : 4), random);  // some cells are inverted
    for (Vec3& x : to) x[2] = plane ? 0 : x[2];
    const std::vector<std::string> walls = mesh->groups.empty() ? std::vector<std::string>{} : std::vector<std::string>{"floor"};
    struct Result {
      std::vector<double> values;
      double amplitude = 0;
      std::size_t inverted = 0;
    };
    std::vector<std::string> names;
    const auto in_unit = [&](double unit) {
      auto other = std::make_shared<Mesh>(*mesh);
      Points there = to;
      for (Vec3& x : other->points) x = unit * x;
      for (Vec3& x : there) x = unit * x;
      other->validate();
      const QualityCheck check(other, walls);
      names.clear();
      for (const QualityCheck::Name& name : check.names()) names.push_back(name.name);
      Result result{check.values(there, names), 0, 0};
      if (const auto cells = cell_set(*other)) {
        const MotionSafety safety = safe_amplitude(other->points, there, *cells);
        result.amplitude = safety.amplitude;
        result.inverted = safety.inverted.count;
      }
      return result;
    };
    const Result given = in_unit(1);
    for (const int exponent : {-130, 130}) {  // 7e-40 and 1.4e39
      const Result other = in_unit(std::exp2(exponent));
      EXPECT_EQ(other.amplitude, given.amplitude);
      EXPECT_EQ(other.inverted, given.inverted);
      for (std::size_t i = 0; i < names.size(); ++i) {
        const double a = given.values[i], b = other.values[i];
        bool same = a == b || (std::isnan(a) && std::isnan(b));
        for (const int power : {-2, -1, 1, 2, 3}) same = same || b == std::ldexp(a, power * exponent);
        EXPECT_TRUE(same) << names[i] << " 2^" << exponent << " of " << mesh->points.size() << " points: " << a << ", " << b;
      }
    }
  }
}

TEST(QualityCheck, RefusesNamesWithWhatIsNear) {
  const QualityCheck check(cube(2, 1));
  expect_error(ErrorCode::invalid_argument, {"\"scaled_jacobain\"", "did you mean", "\"scaled_jacobian\""},
               [&] { check.check("scaled_jacobain"); });
  expect_error(ErrorCode::invalid_argument, {"least_scaled_jacobian", "did you mean", "\"scaled_jacobian\""},
               [&] { check.check("least_scaled_jacobian"); });
  expect_error(ErrorCode::invalid_argument, {"wall_height is measured with walls"}, [&] { check.check("wall_height"); });
  expect_error(ErrorCode::invalid_argument, {"normal_jump is measured between the regions"}, [&] { check.check("normal_jump"); });
  expect_error(ErrorCode::invalid_argument, {"non_orthogonality is measured of other kinds of meshes"},
               [&] { check.check("non_orthogonality"); });
  expect_error(ErrorCode::invalid_argument, {"there are scaled_jacobian, "}, [&] { check.check("colour"); });
  expect_error(ErrorCode::invalid_argument, {"wall_height"}, [&] {
    check.values(cube(2, 1)->points, {"volume", "wall_height"});
  });
  EXPECT_NO_THROW(check.check("inverted_cells"));
  EXPECT_NO_THROW(check.check("hexahedron.volume"));
}

TEST(QualityCheck, RefusesWhatItCannotMeasure) {
  const auto mesh = cube(2, 1);
  const QualityCheck check(mesh);
  const Points few(mesh->points.begin(), mesh->points.end() - 1);
  expect_error(ErrorCode::invalid_argument, {"points: 26", "27"}, [&] { check.values(few, {"volume"}); });
  expect_error(ErrorCode::invalid_argument, {"points: 26", "27"}, [&] { check.report(few); });
  expect_error(ErrorCode::invalid_argument, {"flor: there is no such group", "\"floor\""}, [&] { QualityCheck(mesh, {"flor"}); });
  expect_error(ErrorCode::invalid_argument, {"lone: this group has no boundary faces"}, [&] { QualityCheck(mesh, {"lone"}); });
  auto surface = std::make_shared<Mesh>(*square(2, 1));
  surface->groups = {{"all", {}, {0, 1, 2, 3}}};
  expect_error(ErrorCode::invalid_argument, {"walls", "is a surface"}, [&] { QualityCheck(surface, {"all"}); });
  auto cloud = std::make_shared<Mesh>();
  cloud->points = {{0, 0, 0}};
  expect_error(ErrorCode::invalid_argument, {"no faces and no cells"}, [&] { QualityCheck check_of_points(cloud); });
}

TEST(WallFaces, AreEachTakenOnceInOrder) {
  Mesh mesh = *square(2, 1);
  mesh.groups = {{"a", {}, {3, 1}}, {"b", {}, {1, 0}}};
  EXPECT_EQ(wall_faces(mesh, {"a", "b"}), (std::vector<FaceId>{0, 1, 3}));
}

TEST(QualityNames, HaveThoseOfEveryMesh) {
  std::set<std::string> all;
  for (const QualityName& name : quality_names()) EXPECT_TRUE(all.insert(name.name).second) << name.name << " twice";
  const test::Grid g = test::grid(1, 1, 1);
  auto polyhedra = std::make_shared<Mesh>();
  polyhedra->points = g.points;
  polyhedra->cells = std::make_shared<PolyhedralCells>(g.cells);
  for (const auto& mesh : {cube(2, 1), square(2, 1), std::shared_ptr<const Mesh>(polyhedra)}) {
    const std::vector<std::string> walls = mesh->groups.empty() ? std::vector<std::string>{} : std::vector<std::string>{"floor"};
    const QualityCheck check(mesh, walls);
    for (const QualityCheck::Name& name : check.names()) EXPECT_TRUE(all.contains(name.name)) << name.name;
  }
  for (const char* name : {"normal_jump", "curvature_jump_growth", "tetrahedron.scaled_jacobian", "hexahedron27.volume"}) {
    EXPECT_TRUE(all.contains(name)) << name;
  }
}

TEST(QualityNames, TellCountsFromMeasures) {
  for (const QualityName& name : quality_names()) {
    const bool counts = name.name.ends_with("inverted_elements") || name.name.starts_with("left_handed") ||
                        name.name.ends_with("_faces") || name.name == "inverted_cells" || name.name == "negative_volumes" ||
                        name.name == "wrong_pyramids" || name.name == "non_orthogonality_errors" || name.name == "failed_checks";
    EXPECT_EQ(name.counts, counts) << name.name;
  }
}

}  // namespace
}  // namespace deform::mesh_quality_test
