// SPDX-License-Identifier: GPL-3.0-or-later
// A wing on a symmetry plane, in the tetrahedra around it: the plane stays, and no cell is lost there.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "core/deformers/system.h"
#include "core/io/mesh_file.h"
#include "core/quality/safe_amplitude.h"

namespace deform::symmetry_shared_test {
namespace {

Region group(const char* name) { return {Region::GroupName{name}}; }

TEST(SymmetryShared, WingTwistsInItsPlane) {
  const auto file = io::read_mesh_file(std::filesystem::path(DEFORM_SHARED_DATA) / "B_volume/external/oneraM6_tet.su2.gz");
  const std::shared_ptr<const Mesh> mesh = file->mesh();
  deform::Setup setup;
  setup.handles = {{"wing", {Region::Union{{group("wing_upper"), group("wing_lower"), group("tip"), group("trailing_edge")}}}}};
  setup.fixed = {group("farfield")};
  const auto symmetry = select(group("symmetry"), *mesh, "symmetry");
  Box extent;
  for (const PointId id : symmetry) extent.add(mesh->points[id]);
  std::size_t normal = 0;
  for (std::size_t k = 1; k < 3; ++k) {
    if (extent.max[k] - extent.min[k] < extent.max[normal] - extent.min[normal]) normal = k;
  }
  Vec3 axis{};
  axis[normal] = 1;
  setup.variables = {{"twist", "wing", DesignVariable::Rotate{axis, {0.4, 0, 0}}},
                     {"span", "wing", DesignVariable::Scale{mesh->points[symmetry[0]], axis}}};
  const Design design{{0.1, 0.2}, {}};
  const double D = bounding_box(mesh->points).diagonal();
  const auto leaves = [&](const Points& points) {
    double largest = 0;
    for (const PointId id : symmetry) largest = std::max(largest, std::abs(points[id][normal] - mesh->points[id][normal]));
    return largest;
  };
  const InversionCheck check(mesh->points, CellSet{file->elements().get()});
  auto& options = std::get<RbfOptions>(setup.method);
  options.kernel = Kernel::biharmonic;  // r^3 is ill-conditioned with a far field this far away
  options.basis = BasisMode::never;

  const Points free = prepare(mesh, setup)->evaluate(design);

  setup.symmetry = {{group("symmetry")}};
  const auto system = prepare(mesh, setup);
  const Points slid = system->evaluate(design);
  EXPECT_THAT(system->info().notes, testing::Contains("Symmetry: plane 1 holds 1373 points, 92 of them centres."));
  EXPECT_GT(leaves(free), 1e-5 * D);
  EXPECT_LE(leaves(slid), 1e-12 * D);
  EXPECT_EQ(check.inverted(slid).count, 0u);
  double along = 0;
  for (const PointId id : symmetry) {
    along = std::max(along, std::hypot(slid[id][0] - mesh->points[id][0], slid[id][2] - mesh->points[id][2]));
  }
  EXPECT_GT(along, 0.01);
}

}  // namespace
}  // namespace deform::symmetry_shared_test
