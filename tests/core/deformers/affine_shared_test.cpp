// SPDX-License-Identifier: GPL-3.0-or-later
// All handles of real closed surfaces move by one affine map: every point has to follow to 1e-9 D, by moving least squares with
// few samples. Three meshes, or with DEFORM_LONG=1 all.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/system.h"
#include "core/io/mesh_file.h"
#include "tests/support/end_handles.h"
#include "tests/support/long_tests.h"

namespace deform::affine_shared_test {
namespace {

struct Closed {
  const char* name;
  bool quick;
};

/// Meshes of 160 to 46,000 points; triangles, quads and polygons; with slots, thin walls and holes through them.
constexpr Closed closed_surfaces[] = {{"anchor_dense.off.gz", true},  {"pinion.off", true},
                                      {"fandisk_quads.off", true},    {"bumpy-cube.obj.gz", false},
                                      {"rocker-arm.obj.gz", false},   {"joint_remeshed.off.gz", false},
                                      {"sphere_7800.off.gz", false},  {"ahmed_slant25.stl.gz", false},
                                      {"fandisk_dual.off.gz", false}, {"spool.off", false},
                                      {"flange.stl.gz", false},       {"lion_vase_poly.off.gz", false}};

TEST(AffineMotion, OfAllHandlesIsFollowedByMlsOnRealClosedSurfaces) {
  const bool all = test::long_tests();
  for (const Closed& of : closed_surfaces) {
    if (!all && !of.quick) continue;
    const std::shared_ptr<const Mesh> mesh =
        io::read_mesh_file(std::string(DEFORM_SHARED_DATA) + "/A_surface/" + of.name)->mesh();
    const Box box = bounding_box(mesh->points);
    MlsOptions options;
    options.surface_samples = options.volume_samples = 300;
    deform::Setup setup;
    setup.method = options;
    setup.handles = test::end_handles(*mesh);
    const auto system = prepare(mesh, setup);
    for (const std::string& note : system->info().notes) EXPECT_EQ(note.find("do not enclose"), std::string::npos) << of.name;

    // By 40 degrees about z, stretched and sheared, about the middle.
    const double c = std::cos(0.7), s = std::sin(0.7);
    const Vec3 middle = 0.5 * (box.min + box.max);
    Affine map{1.1 * c, -s, 0.1, 0, s, 0.9 * c, 0.2, 0, -0.1, 0, 1.2, 0};
    const Vec3 image = transformed(map, middle);
    for (std::size_t k = 0; k < 3; ++k) map[4 * k + 3] = middle[k] - image[k] + 0.1 * box.diagonal();
    const Points moved = system->evaluate({{}, {{0, map}, {1, map}}});
    double worst = 0;
    for (std::size_t i = 0; i < moved.size(); ++i) {
      worst = std::max(worst, distance(moved[i], transformed(map, mesh->points[i])));
    }
    EXPECT_LT(worst, 1e-9 * box.diagonal()) << of.name;
  }
}

}  // namespace
}  // namespace deform::affine_shared_test
