// SPDX-License-Identifier: GPL-3.0-or-later
// The template of a method does with its few lines what every method does.
#include "tests/support/uniform_blend.h"

#include <gtest/gtest.h>

#include "core/deformers/methods.h"
#include "tests/core/deformers/energy_cases.h"

namespace deform::uniform_blend_test {
namespace {

using test::UniformBlendMethod;

struct Incomplete {
  using Options = test::UniformBlendOptions;
  static constexpr std::string_view name = "incomplete";
};
static_assert(!Method<Incomplete>);
static_assert(std::is_same_v<MethodList<RbfMethod, UniformBlendMethod>::Of<test::UniformBlendOptions>, UniformBlendMethod>);

std::shared_ptr<const System> sheet_system() {
  const auto mesh = std::make_shared<const Mesh>(test::flat_sheet(21, 11));
  return UniformBlendMethod::prepare({}, mesh, test::setup_with_variables(), {}, 0);
}

TEST(UniformBlend, MovesEveryPointByTheMeanOfTheMaps) {
  const auto system = sheet_system();
  const Mesh mesh = test::flat_sheet(21, 11);
  Affine turn{1, 0, 0, 0, 0, 0.8, -0.6, 0.1, 0, 0.6, 0.8, 0.3};
  const Points points = system->evaluate({{}, {{0, turn}}});
  const SelectedRegions regions = validate(test::setup_with_variables(), mesh);
  const ConstraintPoints held = constraint_points(mesh, regions);
  const double share = 1.0 / static_cast<double>(regions.handles.size() + 1);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vec3 &x = mesh.points[i], to = transformed(turn, x);
    const double weight = held.region_of[i] == 0 ? 1 : held.region_of[i] == deformable_region ? share : 0;
    for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(points[i][k], x[k] + weight * (to[k] - x[k]), 1e-14) << i;
  }
}

TEST(UniformBlend, TakesWhatEverySystemTakes) {
  const auto system = sheet_system();
  EXPECT_EQ(system->info().basis_fields, 8u);
  EXPECT_EQ(system->info().points, 231u);
  EXPECT_LE(system->bytes(), UniformBlendMethod::estimate({}, test::flat_sheet(21, 11), {}, {{{}, {}}, {}, {}, {}}).peak_bytes);
  test::check_jacobians(*system, 1e-12, 1e-8);
  test::check_population(*system, 20);
}

TEST(UniformBlend, TakesTheDirectPathForDisplacementsPerPoint) {
  const auto system = sheet_system();
  const Mesh mesh = test::flat_sheet(21, 11);
  const SelectedRegions regions = validate(test::setup_with_variables(), mesh);
  const Design design{{}, {{0, std::vector<Vec3>(regions.handles[0].size(), Vec3{0, 0, 0.3})}}};
  const auto bound = system->bind({&design, 1}, EvaluationPath::automatic, {});
  EXPECT_EQ(bound->report(0).path, EvaluationPath::direct);
  EXPECT_EQ(bound->report(0).prescribed_displacement, 0.3);
  const Points points = system->evaluate(design);
  for (const PointId id : constraint_points(mesh, regions).deformable) EXPECT_NEAR(points[id][2], 0.1, 1e-15);
}

}  // namespace
}  // namespace deform::uniform_blend_test
