// SPDX-License-Identifier: GPL-3.0-or-later
// Which points become centres is known before anything is prepared, where it is known at all.
#include "core/deformers/methods.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <initializer_list>
#include <optional>
#include <stop_token>
#include <utility>

#include "core/deformers/system.h"
#include "tests/core/deformers/block_meshes.h"
#include "tests/support/expect_error.h"

namespace deform::known_centres_test {
namespace {

/// Both ends of a sheet of 41 x 41 points, with more than three rings of them.
Setup sheet_setup(const RbfOptions& options) {
  Setup setup;
  setup.method = options;
  setup.handles.push_back({"end", {Region::InBox{{0.8, -1, -1}, {2, 2, 1}}}});
  setup.fixed.push_back({Region::InBox{{-1, -1, -1}, {0.2, 2, 1}}});
  return setup;
}

std::shared_ptr<const Mesh> sheet() { return std::make_shared<const Mesh>(test::square(40)); }

/// The sheet with its right end lifted, by rbf with a kernel or without one.
Points lifted(std::shared_ptr<const Mesh> mesh, std::optional<Kernel> kernel) {
  Design design;
  design.motions.push_back({0, Affine{1, 0, 0, 0.1, 0, 1, 0, 0.02, 0, 0, 1, 0}});
  return prepare(std::move(mesh), sheet_setup({.kernel = kernel}))->evaluate(design);
}

TEST(DefaultKernel, IsTheThinPlateInAPlaneAndTriharmonicInSpace) {
  EXPECT_EQ(lifted(sheet(), std::nullopt), lifted(sheet(), Kernel::thin_plate));
  EXPECT_NE(lifted(sheet(), std::nullopt), lifted(sheet(), Kernel::triharmonic));
  Mesh curved = *sheet();
  for (Vec3& x : curved.points) x[2] = 0.1 * x[0] * x[0];
  const auto in_space = std::make_shared<const Mesh>(std::move(curved));
  EXPECT_EQ(lifted(in_space, std::nullopt), lifted(in_space, Kernel::triharmonic));
  EXPECT_EQ(estimate(*sheet(), sheet_setup({})).seconds, estimate(*sheet(), sheet_setup({.kernel = Kernel::thin_plate})).seconds);
}

TEST(KnownCentres, AreThoseOfThePreparedSystem) {
  RbfOptions options;
  options.reduction = CentreReduction::rings;
  const auto reduced = known_centres(*sheet(), sheet_setup(options));
  ASSERT_TRUE(reduced.has_value());
  EXPECT_EQ(reduced->size(), prepare(sheet(), sheet_setup(options))->info().centres);
  EXPECT_EQ(reduced->size(), 2U * 3U * 41U) << "three rings on either side";
  EXPECT_TRUE(std::is_sorted(reduced->begin(), reduced->end()));
  for (const PointId id : *reduced) {
    const double x = sheet()->points[id][0];
    EXPECT_TRUE((x > 0.14 && x < 0.21) || (x > 0.79 && x < 0.86)) << id;
  }
  options.reduction = CentreReduction::off;
  const auto all = known_centres(*sheet(), sheet_setup(options));
  ASSERT_TRUE(all.has_value());
  EXPECT_EQ(all->size(), 2U * 9U * 41U);
  EXPECT_EQ(all->size(), prepare(sheet(), sheet_setup(options))->info().centres);
}

TEST(KnownCentres, AreNotThereWhereTheyAreChosenWhilePreparing) {
  RbfOptions options;
  options.solver = Solver::incremental_qr;
  EXPECT_FALSE(known_centres(*sheet(), sheet_setup(options)).has_value());
  auto setup = sheet_setup({});
  setup.method = MlsOptions{};
  EXPECT_FALSE(known_centres(*sheet(), setup).has_value());
}

TEST(KnownCentres, OfRegionsThatWereSelectedAreTheSame) {
  RbfOptions options;
  options.reduction = CentreReduction::rings;
  auto setup = sheet_setup(options);
  EXPECT_EQ(known_centres(*sheet(), setup, validate(setup, *sheet())), known_centres(*sheet(), setup));
  setup.handles.push_back({"middle", {Region::InBox{{0.4, -1, -1}, {0.6, 2, 1}}}, 1});
  setup.then.push_back({options, {Region{Region::InBox{{-1, -1, -1}, {0.1, 2, 1}}}}});
  const auto of_both = known_centres(*sheet(), setup);
  ASSERT_TRUE(of_both.has_value());
  EXPECT_EQ(known_centres(*sheet(), setup, validate(setup, *sheet())), of_both);
}

TEST(Estimate, StopsWhenItIsCancelled) {
  std::stop_source stop;
  RunContext context;
  context.stop = stop.get_token();
  stop.request_stop();
  const auto mesh = sheet();
  const auto stops = [&](const auto& setup) {
    const SelectedRegions regions = validate(setup, *mesh);
    EXPECT_NO_THROW(estimate(*mesh, setup, regions));
    test::expect_error(ErrorCode::cancelled, {}, [&] { estimate(*mesh, setup, regions, context); });
  };
  for (const MethodOptions& method :
       std::initializer_list<MethodOptions>{RbfOptions{}, ShellOptions{}, SubspaceOptions{}, MlsOptions{}, FfdOptions{}}) {
    auto setup = sheet_setup({});
    setup.method = method;
    stops(setup);
  }
  auto mirrored = sheet_setup({});
  mirrored.method = ShellOptions{};
  mirrored.symmetry.push_back({SymmetryPlane::Plane{{0, 0, 0}, {0, 1, 0}}});
  stops(mirrored);
  auto composed = sheet_setup({});
  composed.handles.push_back({"middle", {Region::InBox{{0.4, -1, -1}, {0.6, 2, 1}}}, 1});
  composed.then.push_back({RbfOptions{}, {Region{Region::InBox{{-1, -1, -1}, {0.1, 2, 1}}}}});
  stops(composed);
  const SelectedRegions regions = validate(sheet_setup({}), *mesh);
  test::expect_error(ErrorCode::cancelled, {}, [&] { known_centres(*mesh, sheet_setup({}), regions, context); });
}

}  // namespace
}  // namespace deform::known_centres_test
