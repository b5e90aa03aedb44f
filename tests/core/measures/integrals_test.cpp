// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/measures/integrals.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "core/mesh/cells.h"
#include "core/mesh/elements.h"
#include "tests/core/measures/measure_checks.h"
#include "tests/core/quality/surface_meshes.h"
#include "tests/support/expect_error.h"

namespace deform::measures::integrals_test {
namespace {

using test::expect_error;

double value(const Measure& measure, const Points& points) { return measure.evaluate(points, Gradients::left_out).values[0]; }

/// Signed volume of cones to an apex, in long double, by Cramer's determinant; faces as fans around their first corner.
struct Solid {
  long double volume = 0;
  std::array<long double, 3> moment{};  ///< about the origin
};

Solid solid(const Mesh& mesh, const Points& points, const Vec3& apex) {
  Solid sum;
  std::size_t at = 0;
  for (const std::uint32_t size : mesh.face_sizes) {
    for (std::size_t i = 2; i < size; ++i) {
      std::array<std::array<long double, 3>, 3> e;
      std::array<long double, 3> middle{apex[0], apex[1], apex[2]};
      const std::array<PointId, 3> ids{mesh.face_points[at], mesh.face_points[at + i - 1], mesh.face_points[at + i]};
      for (std::size_t c = 0; c < 3; ++c) {
        for (std::size_t k = 0; k < 3; ++k) {
          e[c][k] = static_cast<long double>(points[ids[c]][k]) - apex[k];
          middle[k] += points[ids[c]][k];
        }
      }
      const long double volume =
          (e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) - e[0][1] * (e[1][0] * e[2][2] - e[1][2] * e[2][0]) +
           e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0])) /
          6;
      sum.volume += volume;
      for (std::size_t k = 0; k < 3; ++k) sum.moment[k] += volume * middle[k] / 4;
    }
    at += size;
  }
  return sum;
}

/// Heron's formula for the area; for the projected one the shoelace formula in the plane of two vectors across the direction.
double heron(const Vec3& a, const Vec3& b, const Vec3& c) {
  const long double x = distance(a, b), y = distance(b, c), z = distance(c, a), s = (x + y + z) / 2;
  return static_cast<double>(std::sqrt(std::max(s * (s - x) * (s - y) * (s - z), 0.0L)));
}

TEST(Volume, OfABlockOfQuads) {
  for (const double unit : {1e-3, 1.0, 2e4}) {
    const Mesh mesh = test::block({2 * unit, 3 * unit, 5 * unit}, 3);
    EXPECT_NEAR(value(*make_volume(mesh, {}, Rims::refuse), mesh.points), 30 * unit * unit * unit,
                1e-13 * 30 * unit * unit * unit);
    EXPECT_NEAR(value(*make_area(mesh, {}), mesh.points), 62 * unit * unit, 1e-13 * 62 * unit * unit);
    EXPECT_NEAR(value(*make_projected_area(mesh, {}, {0, 0, 7}), mesh.points), 6 * unit * unit, 1e-13 * 6 * unit * unit);
    const auto centre = make_centre_of_gravity(mesh, {}, Rims::refuse)->evaluate(mesh.points, Gradients::left_out).values;
    for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(centre[k], (std::array{1.0, 1.5, 2.5}[k] * unit), 1e-13 * unit);
  }
}

TEST(Volume, AndCentreOfGravityAreThoseOfConesToAnotherApex) {
  for (const double unit : {1e-4, 1.0, 3e3}) {
    Mesh mesh = test::sphere(unit, 4);
    const auto volume = make_volume(mesh, {}, Rims::refuse);
    const auto centre = make_centre_of_gravity(mesh, {}, Rims::refuse);
    const Points points = test::plus(mesh.points, 0.3 * unit, test::waves(mesh.points, 1, 5));
    const Solid expected = solid(mesh, points, {3 * unit, -unit, 0.5 * unit});
    const auto found = static_cast<double>(expected.volume);
    EXPECT_NEAR(value(*volume, points), found, 1e-13 * std::abs(found));
    const auto values = centre->evaluate(points, Gradients::left_out).values;
    for (std::size_t k = 0; k < 3; ++k)
      EXPECT_NEAR(values[k], static_cast<double>(expected.moment[k] / expected.volume), 1e-12 * unit);
  }
}

TEST(Volume, FarFromTheOrigin) {
  Mesh mesh = test::sphere(1, 4);
  const double at_origin = value(*make_volume(mesh, {}, Rims::refuse), mesh.points);
  for (Vec3& p : mesh.points) p = p + Vec3{1e5, -2e5, 3e4};
  // Coordinates are rounded to 1e-16 of 2e5; the sums must not add to that.
  EXPECT_NEAR(value(*make_volume(mesh, {}, Rims::refuse), mesh.points), at_origin, 1e-10);
  const auto centre = make_centre_of_gravity(mesh, {}, Rims::refuse)->evaluate(mesh.points, Gradients::left_out).values;
  EXPECT_NEAR(centre[0], 1e5, 1e-10);
  EXPECT_NEAR(centre[1], -2e5, 1e-10);
}

TEST(Area, AndProjectedAreaOfAnyFaces) {
  for (const double unit : {1e-3, 1.0, 1e4}) {
    const Mesh mesh = test::sheet(7, 9, test::Faces::triangles, [&](std::uint32_t i, std::uint32_t j) {
      return Vec3{unit * i, unit * j, unit * std::sin(0.7 * i * j)};
    });
    const Points points = test::shaken(mesh.points, 0.1 * unit, 3);
    const Vec3 direction{1, -2, 0.5};
    const Vec3 d = direction / length(direction), u = cross(d, {0, 0, 1}) / length(cross(d, {0, 0, 1})), v = cross(d, u);
    double area = 0, projected = 0;
    for (std::size_t t = 0; t < mesh.face_count(); ++t) {
      std::array<Vec3, 3> c;
      for (std::size_t i = 0; i < 3; ++i) c[i] = points[mesh.face_points[3 * t + i]];
      area += heron(c[0], c[1], c[2]);
      double shoelace = 0;
      for (std::size_t i = 0; i < 3; ++i)
        shoelace += dot(c[i], u) * dot(c[(i + 1) % 3], v) - dot(c[(i + 1) % 3], u) * dot(c[i], v);
      projected += std::abs(shoelace) / 4;
    }
    EXPECT_NEAR(value(*make_area(mesh, {}), points), area, 1e-12 * area);
    EXPECT_NEAR(value(*make_projected_area(mesh, {}, direction), points), projected, 1e-12 * projected);
  }
}

TEST(Integrals, GradientsAreThoseOfDifferences) {
  for (const double unit : {1e-3, 1.0, 1e3}) {
    for (Mesh mesh : {test::sphere(unit, 3), test::block({unit, 2 * unit, 0.3 * unit}, 4)}) {
      for (Vec3& p : mesh.points) p = p + Vec3{3 * unit, -unit, 9 * unit};
      const Points points = test::plus(mesh.points, 0.05 * unit, test::waves(mesh.points, 1, 8));
      test::expect_gradient(*make_volume(mesh, {}, Rims::refuse), points, 1e-9);
      test::expect_gradient(*make_centre_of_gravity(mesh, {}, Rims::refuse), points, 1e-9);
      test::expect_gradient(*make_area(mesh, {}), points, 1e-8, 1e-4);
      test::expect_gradient(*make_projected_area(mesh, {}, {0.3, 1, -0.2}), points, 1e-8, 1e-7);
    }
  }
}

TEST(Integrals, SameBitsForAnyNumberOfThreads) {
  const Mesh mesh = test::sphere(1, 6);
  const Points points = test::shaken(mesh.points, 0.001, 2);
  test::expect_same_bits(*make_volume(mesh, {}, Rims::refuse), points);
  test::expect_same_bits(*make_centre_of_gravity(mesh, {}, Rims::refuse), points);
  test::expect_same_bits(*make_area(mesh, {}), points);
  test::expect_same_bits(*make_projected_area(mesh, {}, {1, 1, 1}), points);
}

TEST(Integrals, FacetsWithCornersOfTheirOwn) {
  const Mesh mesh = test::sphere(2, 3), torn = test::torn(mesh);
  const auto whole = make_volume(mesh, {}, Rims::refuse)->evaluate(mesh.points, Gradients::wanted);
  const auto parts = make_volume(torn, {}, Rims::refuse)->evaluate(torn.points, Gradients::wanted);
  EXPECT_NEAR(parts.values[0], whole.values[0], 1e-13 * whole.values[0]);
  Points sum(mesh.point_count());
  for (std::size_t i = 0; i < torn.point_count(); ++i) {
    sum[mesh.face_points[i]] = sum[mesh.face_points[i]] + parts.gradients[0][i];
  }
  for (std::size_t i = 0; i < sum.size(); ++i) EXPECT_LT(distance(sum[i], whole.gradients[0][i]), 1e-14);
}

TEST(Volume, TurnsFacesThatPointInwards) {
  Mesh mesh = test::sphere(1, 3), inwards = mesh;
  for (std::size_t t = 0; t < mesh.face_count(); ++t) std::swap(inwards.face_points[3 * t], inwards.face_points[3 * t + 1]);
  const auto outer = make_volume(mesh, {}, Rims::refuse)->evaluate(mesh.points, Gradients::wanted);
  const auto inner = make_volume(inwards, {}, Rims::refuse)->evaluate(mesh.points, Gradients::wanted);
  EXPECT_NEAR(inner.values[0], outer.values[0], 1e-13);
  EXPECT_LT(distance(inner.gradients[0][5], outer.gradients[0][5]), 1e-14);
  Points inside_out = mesh.points;
  for (Vec3& p : inside_out) p[0] = -p[0];
  EXPECT_NEAR(value(*make_volume(mesh, {}, Rims::refuse), inside_out), -outer.values[0], 1e-13);
  expect_error(ErrorCode::numerical_failure, {"points: ", "enclose no volume"},
               [&] { make_centre_of_gravity(mesh, {}, Rims::refuse)->evaluate(inside_out, Gradients::left_out); });
}

TEST(Volume, ClosesPlaneRimsExactly) {
  // A prism of 24 sides: its ends are open.
  constexpr double radius = 0.7, height = 1.9;
  Mesh mesh = test::tube(radius, 24, 5, height, test::Faces::quads);
  const double base = 12 * radius * radius * std::sin(2 * std::numbers::pi / 24);
  const auto volume = make_volume(mesh, {}, Rims::close);
  EXPECT_NEAR(value(*volume, mesh.points), base * height, 1e-13);
  const auto centre = make_centre_of_gravity(mesh, {}, Rims::close);
  EXPECT_NEAR(centre->evaluate(mesh.points, Gradients::left_out).values[2], height / 2, 1e-13);
  const Points points = test::shaken(mesh.points, 0.02, 4);
  test::expect_gradient(*volume, points, 1e-9);
  test::expect_gradient(*centre, points, 1e-9);
  test::expect_gradient(*make_volume(test::torn(mesh), {}, Rims::close), test::torn(mesh).points, 1e-9);
  expect_error(ErrorCode::invalid_argument, {"faces: ", "not closed", "edge of points 0 and 1, one of 48"},
               [&] { make_volume(mesh, {}, Rims::refuse); });
}

TEST(Volume, OfGroupsOfFaces) {
  Mesh mesh = test::sphere(1, 3);
  const Mesh other = test::block({3, 1, 1}, 2);
  const auto first = static_cast<PointId>(mesh.point_count());
  Group ball{"ball", {}, {}}, box{"box", {}, {}};
  for (FaceId f = 0; f < mesh.face_count(); ++f) ball.faces.push_back(f);
  for (FaceId f = 0; f < other.face_count(); ++f) box.faces.push_back(static_cast<FaceId>(mesh.face_count() + f));
  mesh.points.insert(mesh.points.end(), other.points.begin(), other.points.end());
  mesh.face_sizes.insert(mesh.face_sizes.end(), other.face_sizes.begin(), other.face_sizes.end());
  for (const PointId corner : other.face_points) mesh.face_points.push_back(first + corner);
  Group part{"part", {}, {ball.faces[0], ball.faces[1]}};
  mesh.groups = {ball, box, part, {"nothing", {1, 2}, {}}};
  const double of_ball = value(*make_volume(mesh, {{"ball"}, {}}, Rims::refuse), mesh.points);
  const auto found = make_volume(mesh, {{"box"}, {}}, Rims::refuse)->evaluate(mesh.points, Gradients::wanted);
  EXPECT_NEAR(found.values[0], 3, 1e-13);
  EXPECT_EQ(found.gradients[0][0], Vec3{});
  EXPECT_NEAR(value(*make_volume(mesh, {}, Rims::refuse), mesh.points), of_ball + 3, 1e-13);
  EXPECT_NEAR(value(*make_volume(mesh, {{"box", "ball", "part"}, {}}, Rims::refuse), mesh.points), of_ball + 3, 1e-13);
  EXPECT_NEAR(value(*make_area(mesh, {{"box"}, {}}), mesh.points), 14, 1e-13);
  expect_error(ErrorCode::invalid_argument, {"groups[1]: there is no group \"bll\"; did you mean \"ball\""}, [&] {
    make_volume(mesh, {{"box", "bll"}, {}}, Rims::refuse);
  });
  expect_error(ErrorCode::invalid_argument, {"groups[0]: group \"nothing\" has no faces"}, [&] {
    make_area(mesh, {{"nothing"}, {}});
  });
  expect_error(ErrorCode::invalid_argument, {"groups: the faces are not closed"}, [&] {
    make_volume(mesh, {{"part"}, {}}, Rims::refuse);
  });
}

Mesh bricks() {
  Mesh mesh;
  for (int k = 0; k <= 2; ++k) {
    for (int j = 0; j <= 3; ++j) {
      for (int i = 0; i <= 4; ++i) mesh.points.push_back({0.5 * i, 0.7 * j, 0.9 * k});
    }
  }
  auto elements = std::make_shared<Elements>();
  const auto id = [](int i, int j, int k) { return static_cast<PointId>((k * 4 + j) * 5 + i); };
  for (int k = 0; k < 2; ++k) {
    for (int j = 0; j < 3; ++j) {
      for (int i = 0; i < 4; ++i) {
        elements->add(ElementType::hexahedron,
                      std::array{id(i, j, k), id(i + 1, j, k), id(i + 1, j + 1, k), id(i, j + 1, k), id(i, j, k + 1),
                                 id(i + 1, j, k + 1), id(i + 1, j + 1, k + 1), id(i, j + 1, k + 1)});
      }
    }
  }
  mesh.elements = elements;
  return mesh;
}

TEST(Volume, OfCells) {
  const Mesh mesh = bricks();
  const FaceChoice cells{{}, FaceSource::cells};
  const auto volume = make_volume(mesh, cells, Rims::refuse);
  EXPECT_NEAR(value(*volume, mesh.points), 2 * 2.1 * 1.8, 1e-13);
  EXPECT_NEAR(value(*make_area(mesh, cells), mesh.points), 2 * (2 * 2.1 + 2.1 * 1.8 + 1.8 * 2), 1e-13);
  // Points inside move nothing.
  const auto found = volume->evaluate(test::shaken(mesh.points, 0.01, 3), Gradients::wanted);
  for (int j = 1; j < 3; ++j) EXPECT_EQ(found.gradients[0][static_cast<std::size_t>((4 + j) * 5 + 2)], Vec3{});
  test::expect_gradient(*volume, test::shaken(mesh.points, 0.01, 3), 1e-9);
  expect_error(ErrorCode::invalid_argument, {"faces: the mesh has none"}, [&] { make_volume(mesh, {}, Rims::refuse); });
  expect_error(ErrorCode::invalid_argument, {"groups: cells have none"}, [&] { make_area(mesh, {{"a"}, FaceSource::cells}); });
  expect_error(ErrorCode::invalid_argument, {"cells: the mesh has none"}, [&] { make_area(test::sphere(1, 1), cells); });
}

TEST(Volume, OfPolyhedralCells) {
  // Two cubes with a face between them, which counts for neither.
  Mesh mesh;
  for (const double z : {0.0, 1.0}) {
    for (const double y : {0.0, 1.0}) {
      for (const double x : {0.0, 1.0, 2.0}) mesh.points.push_back({x, y, z});
    }
  }
  auto cells = std::make_shared<PolyhedralCells>();
  cells->cell_count = 2;
  const auto add = [&](std::array<PointId, 4> face, std::uint32_t owner) {
    cells->face_points.insert(cells->face_points.end(), face.begin(), face.end());
    cells->face_offsets.push_back(cells->face_points.size());
    cells->owner.push_back(owner);
  };
  add({1, 4, 10, 7}, 0);
  cells->neighbour = {1};
  add({0, 6, 9, 3}, 0);
  add({0, 3, 4, 1}, 0);
  add({6, 7, 10, 9}, 0);
  add({0, 1, 7, 6}, 0);
  add({3, 9, 10, 4}, 0);
  add({2, 5, 11, 8}, 1);
  add({1, 4, 5, 2}, 1);
  add({7, 8, 11, 10}, 1);
  add({1, 2, 8, 7}, 1);
  add({4, 10, 11, 5}, 1);
  mesh.cells = cells;
  mesh.validate();
  EXPECT_NEAR(value(*make_volume(mesh, {{}, FaceSource::cells}, Rims::refuse), mesh.points), 2, 1e-14);
}

TEST(Integrals, BadInput) {
  const Mesh mesh = test::sphere(1, 1);
  const auto area = make_area(mesh, {});
  EXPECT_EQ(area->point_count(), 18U);
  expect_error(ErrorCode::invalid_argument, {"points: 2, the mesh has 18"},
               [&] { area->evaluate(Points(2), Gradients::left_out); });
  Points points = mesh.points;
  points[4][1] = std::nan("");
  expect_error(ErrorCode::invalid_argument, {"points[4]", "y"}, [&] { area->evaluate(points, Gradients::left_out); });
  for (const Vec3& direction : {Vec3{}, Vec3{0, HUGE_VAL, 0}, Vec3{0, 0, std::nan("")}}) {
    expect_error(ErrorCode::invalid_argument, {"direction: "}, [&] { make_projected_area(mesh, {}, direction); });
  }
  RunContext context;
  std::stop_source stop;
  stop.request_stop();
  context.stop = stop.get_token();
  expect_error(ErrorCode::cancelled, {}, [&] { area->evaluate(mesh.points, Gradients::left_out, context); });
}

TEST(Area, OfFacesWithoutAreaHasNoNan) {
  Mesh mesh = test::sphere(1, 1);
  const PointId a = mesh.face_points[0];
  test::add_face(mesh, {a, a, mesh.face_points[1]});
  const auto found = make_area(mesh, {})->evaluate(mesh.points, Gradients::wanted);
  EXPECT_TRUE(std::isfinite(found.values[0]));
  for (const Vec3& slope : found.gradients[0]) EXPECT_TRUE(is_finite(slope));
}

}  // namespace
}  // namespace deform::measures::integrals_test
