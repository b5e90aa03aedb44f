// SPDX-License-Identifier: GPL-3.0-or-later
// Measures of real meshes. Expected volumes, areas and centres of gravity are those of trimesh 4 (an independent implementation).
#include <gtest/gtest.h>

#include <filesystem>

#include "core/io/mesh_file.h"
#include "core/measures/clearance.h"
#include "core/measures/integrals.h"
#include "core/measures/sobolev_filter.h"
#include "core/measures/thickness.h"
#include "tests/core/measures/measure_checks.h"
#include "tests/support/expect_error.h"

namespace deform::measures::shared_data_test {
namespace {

std::shared_ptr<const Mesh> read(const std::string& name) {
  return io::read_mesh_file(std::filesystem::path(DEFORM_SHARED_DATA) / name)->mesh();
}

struct Row {
  const char* file;
  double volume, area;
  Vec3 centre;
};

const Row rows[] = {
    {"A_surface/rocker-arm.obj.gz",
     0.04251362358052909,
     1.2965518606981843,
     {-0.00908434365873478, 0.03822403938149583, 0.026183650167087683}},
    {"A_surface/flange.stl.gz",
     1.5623103681020335e-05,
     0.007302919070375589,
     {-9.686653526145553e-09, -0.0022498956346845983, -0.009510256575529029}},
    {"A_surface/fandisk_quads.off",
     20.25750477234312,
     60.46202475997612,
     {2.349017087206226, 14.777569345541302, -0.9708614441414775}},
    {"A_surface/anchor_dense.off.gz",
     0.14354118154207843,
     2.7563232774334656,
     {0.11049700323633324, 9.148226908150455e-06, -0.013066376069405394}},
};

TEST(MeasuresOfRealMeshes, AreThoseOfTrimesh) {
  for (const Row& row : rows) {
    SCOPED_TRACE(row.file);
    const auto mesh = read(row.file);
    const double diagonal = bounding_box(mesh->points).diagonal();
    EXPECT_NEAR(make_volume(*mesh, {}, Rims::refuse)->evaluate(mesh->points, Gradients::left_out).values[0], row.volume,
                1e-12 * row.volume);
    EXPECT_NEAR(make_area(*mesh, {})->evaluate(mesh->points, Gradients::left_out).values[0], row.area, 1e-12 * row.area);
    const auto centre = make_centre_of_gravity(*mesh, {}, Rims::refuse)->evaluate(mesh->points, Gradients::left_out).values;
    for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(centre[k], row.centre[k], 1e-12 * diagonal);
  }
}

TEST(MeasuresOfRealMeshes, GradientsAreThoseOfDifferences) {
  for (const Row& row : rows) {
    SCOPED_TRACE(row.file);
    const auto mesh = read(row.file);
    const Box box = bounding_box(mesh->points);
    const double diagonal = box.diagonal();
    const Points points = test::plus(mesh->points, 2e-3 * diagonal, test::waves(mesh->points, 1, 3));
    test::expect_gradient(*make_volume(*mesh, {}, Rims::refuse), points, 1e-9);
    test::expect_gradient(*make_centre_of_gravity(*mesh, {}, Rims::refuse), points, 1e-9);
    // These have kinks wherever a face turns, or another one gets to be the nearest: the differences are short.
    test::expect_gradient(*make_area(*mesh, {}), points, 1e-6, 1e-7);
    test::expect_gradient(*make_projected_area(*mesh, {}, {1, 0.4, -0.3}), points, 1e-4, 1e-8);
    ThicknessOptions options;
    options.tolerance = 0.02 * diagonal;
    test::expect_gradient(*make_thickness(*mesh, options), points, 1e-4, 1e-8);
    test::expect_gradient(*make_clearance(*mesh, {}, Box{box.max - (box.max - box.min) / 3, box.max}, 0.02 * diagonal), points,
                          1e-5, 1e-8);
    if (mesh->point_count() > 3500) continue;  // takes seconds
    options.method = ThicknessMethod::spheres;
    test::expect_gradient(*make_thickness(*mesh, options), points, 1e-4, 1e-8);
  }
}

TEST(MeasuresOfRealMeshes, FilterConvergesAndKeepsConstants) {
  for (const Row& row : rows) {
    SCOPED_TRACE(row.file);
    const auto mesh = read(row.file);
    SobolevOptions options;
    options.length = 0.05 * bounding_box(mesh->points).diagonal();
    const Filtered found =
        SobolevFilter(*mesh, mesh->points, options).apply(std::vector<double>(mesh->point_count(), 1), 1, SobolevForm::density);
    EXPECT_TRUE(found.converged);
    for (const double value : found.field) ASSERT_NEAR(value, 1, 1e-7);
  }
}

TEST(MeasuresOfRealMeshes, OfACarInTheAir) {
  // snappyHexMesh: the cells of the air around the car, and its patch, which points into the car.
  const auto mesh = read("B_volume/openfoam/car_fastback");
  const double air =
      make_volume(*mesh, {{}, FaceSource::cells}, Rims::refuse)->evaluate(mesh->points, Gradients::left_out).values[0];
  EXPECT_GT(air, 0);
  EXPECT_NEAR(air, make_volume(*mesh, {}, Rims::refuse)->evaluate(mesh->points, Gradients::left_out).values[0], 1e-9 * air);
  test::expect_error(ErrorCode::invalid_argument, {"groups: the faces are not closed"}, [&] {
    make_volume(*mesh, {{"car_body"}, {}}, Rims::refuse);
  });
}

}  // namespace
}  // namespace deform::measures::shared_data_test
