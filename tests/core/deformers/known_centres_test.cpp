// SPDX-License-Identifier: GPL-3.0-or-later
// Which points become centres is known before anything is prepared, where it is known at all.
#include "core/deformers/methods.h"

#include <gtest/gtest.h>

#include "core/deformers/system.h"
#include "tests/core/deformers/block_meshes.h"

namespace deform {
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

TEST(KnownCentres, AreThoseOfThePreparedSystem) {
  RbfOptions options;
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

}  // namespace
}  // namespace deform
