// SPDX-License-Identifier: GPL-3.0-or-later
// Plane elements whose measures are known, in either orientation and at any size and height.
#include "core/quality/plane_quality.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/quality/report.h"
#include "core/quality/safe_amplitude.h"
#include "core/quality/surface_quality.h"
#include "tests/core/mesh/named_meshes.h"
#include "tests/support/expect_error.h"

namespace deform::plane_quality_test {
namespace {

using test::make_mesh;

PlaneQuality measured(const Mesh& mesh) { return plane_quality(mesh.points, mesh, left_handed_cells(mesh.points, &mesh)); }

TEST(PlaneQuality, KnownShapes) {
  struct Shape {
    Points points;
    double scaled_jacobian, skewness;
  };
  const double h = std::sqrt(0.75);
  for (const Shape& shape : {Shape{{{0, 0, 0}, {1, 0, 0}, {0.5, h, 0}}, h, 0},
                             Shape{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, std::sqrt(0.5), 0.25},       // 45, 45, 90 degrees
                             Shape{{{0, 0, 0}, {3, 0, 0}, {3, 1, 0}, {0, 1, 0}}, 1, 0},            // a rectangle
                             Shape{{{0, 0, 0}, {1, 0, 0}, {1.5, h, 0}, {0.5, h, 0}}, h, 1.0 / 3},  // a rhomb: 60, 120
                             Shape{{{0, 0, 0}, {1, 0, 0}, {0.2, 0.2, 0}, {0, 1, 0}}, -0.6 / 0.68, 1}}) {
    for (const double scale : {1.0, 1e-6, 1e5}) {
      for (const bool clockwise : {false, true}) {
        Mesh mesh = shape.points.size() == 3 ? make_mesh(shape.points, {{0, 1, 2}}) : make_mesh(shape.points, {{0, 1, 2, 3}});
        for (Vec3& p : mesh.points) p = {scale * p[0], (clockwise ? -scale : scale) * p[1], 7 * scale};
        const PlaneQuality q = measured(mesh);
        if (shape.scaled_jacobian > 0) {
          EXPECT_EQ(q.left_handed, clockwise ? 1u : 0u);
        }
        if (shape.scaled_jacobian < 0 && clockwise) continue;  // what a lone concave quad should be nobody knows
        EXPECT_NEAR(q.least_scaled_jacobian.value, shape.scaled_jacobian, 1e-9);
        EXPECT_NEAR(q.largest_skewness.value, shape.skewness, 1e-9);
        EXPECT_EQ(q.inverted_elements, shape.scaled_jacobian > 0 ? 0u : 1u);
      }
    }
  }
}

TEST(PlaneQuality, FindsTheInvertedElement) {
  Mesh mesh = test::quad_grid(4, 3);
  const std::vector<char> orientation = left_handed_cells(mesh.points, &mesh);
  EXPECT_TRUE(orientation.empty());
  mesh.points[6] = {2.5, 1.5, 0};  // through its neighbours
  const PlaneQuality q = plane_quality(mesh.points, mesh, orientation);
  EXPECT_EQ(q.inverted_elements, InversionCheck(mesh.points, &mesh).at_rest().count);
  EXPECT_GT(q.inverted_elements, 0u);
  EXPECT_EQ(q.worst[0], q.least_scaled_jacobian.id);
  QualityReport report = quality_report(surface_quality(mesh), mesh);
  add_to(report, q, mesh.points, mesh);
  ASSERT_NE(report.find("inverted_elements"), nullptr);
  EXPECT_EQ(report.find("inverted_elements")->value, static_cast<double>(q.inverted_elements));
  EXPECT_EQ(report.find("scaled_jacobian")->id, q.least_scaled_jacobian.id);
  EXPECT_NE(report.find("skewness"), nullptr);
  EXPECT_EQ(report.worst.front().title, "Elements of least scaled Jacobian");
  const std::vector<WorstList::Entry>& worst = report.worst.front().entries;
  ASSERT_EQ(worst.size(), q.worst.size());
  const std::vector<std::uint64_t> offsets = mesh.face_offsets();
  for (std::size_t i = 0; i < worst.size(); ++i) {
    EXPECT_EQ(worst[i].id, q.worst[i]);
    EXPECT_EQ(worst[i].value, q.scaled_jacobian[worst[i].id]);
    Vec3 middle{};
    for (std::size_t k = offsets[worst[i].id]; k < offsets[worst[i].id + 1]; ++k)
      middle = middle + mesh.points[mesh.face_points[k]];
    EXPECT_LT(distance(worst[i].position, middle / static_cast<double>(mesh.face_sizes[worst[i].id])), 1e-14);
  }
}

// Boundary layers far smaller than the mesh are no degenerate faces; faces without area are, whatever their size.
TEST(PlaneQuality, DegenerateIsRelativeToTheFace) {
  Mesh mesh = make_mesh({{-100, -100, 0}, {100, -100, 0}, {100, 100, 0}, {-100, 100, 0}},  // far field
                        {{0, 1, 2, 3}});
  const auto add = [&](double x, double length, double height) {
    const auto first = static_cast<PointId>(mesh.point_count());
    for (const Vec3& p : {Vec3{x, 0, 0}, {x + length, 0, 0}, {x + length, height, 0}, {x, height, 0}}) mesh.points.push_back(p);
    mesh.face_sizes.push_back(4);
    for (PointId k = 0; k < 4; ++k) mesh.face_points.push_back(first + k);
  };
  add(0.1, 1e-3, 1e-6);  // 1e-9, and 1e-12 D^2 is 8e-8
  add(0.2, 1e-4, 1e-7);
  EXPECT_EQ(surface_quality(mesh).degenerate_faces, 0u);
  add(0.3, 1e-3, 0);
  add(0.4, 1e-3, 1e-17);
  add(50, 0, 0);
  EXPECT_EQ(surface_quality(mesh).degenerate_faces, 3u);
}

TEST(PlaneQuality, Refuses) {
  const Mesh pentagon = make_mesh({{0, 0, 0}, {1, 0, 0}, {2, 1, 0}, {1, 2, 0}, {0, 1, 0}}, {{0, 1, 2, 3, 4}});
  test::expect_error(ErrorCode::invalid_argument, {"faces[0]", "5 corners"},
                     [&] { plane_quality(pentagon.points, pentagon, {}); });
  test::expect_error(ErrorCode::invalid_argument, {"no faces"}, [] { plane_quality({}, Mesh{}, {}); });
}

}  // namespace
}  // namespace deform::plane_quality_test
