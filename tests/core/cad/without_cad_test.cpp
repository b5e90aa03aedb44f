// SPDX-License-Identifier: GPL-3.0-or-later
// What programs without OpenCASCADE say. The source that does so is compiled into this test, whatever the others are built with.
#include <gtest/gtest.h>

#include "core/cad/availability.h"
#include "core/cad/cad_apply.h"
#include "core/cad/cad_move.h"
#include "core/cad/cad_regions.h"
#include "tests/support/expect_error.h"

namespace deform::cad::without_cad_test {
namespace {

TEST(WithoutCad, EveryFrontNamesThePackagesAndTheOption) {
  EXPECT_FALSE(available());
  const std::vector<const char*> parts{"built without CAD", "install libocct-data-exchange-dev", "-DDEFORM_WITH_CAD=ON"};
  const auto expect_refused = [&](const auto& action) { test::expect_error(ErrorCode::failed_precondition, parts, action); };
  expect_refused([] { require(); });
  expect_refused([] { check_request(ApplyRequest{}); });
  expect_refused([] { apply_to_model({}, [](std::span<const Vec3> points) { return Points(points.begin(), points.end()); }); });
  expect_refused([] { carry_nodes({}, {}); });
  expect_refused([] { cad_regions({}, {}); });
}

}  // namespace
}  // namespace deform::cad::without_cad_test
