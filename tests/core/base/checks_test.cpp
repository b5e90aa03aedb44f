// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/base/checks.h"

#include <gtest/gtest.h>

#include <limits>

#include "tests/support/expect_error.h"

namespace deform::checks_test {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

template <typename Action>
void expect_refused(const char* message, const Action& action) {
  test::expect_error(ErrorCode::invalid_argument, {message}, action);
}

TEST(Checks, NameTheIdThatIsOutOfRange) {
  const std::vector<PointId> ids{0, 4, 5, 9};
  check_ids(ids, 10, "ids", "point");
  check_ids({}, 0, "ids", "point");
  expect_refused("handle: ids[2]: point 5 is out of range, there are 5 points",
                 [&] { check_ids(ids, 5, "handle: ids", "point"); });
  expect_refused("faces[17]: cell 5 is out of range, there are 5 cells", [&] {
    check_ids(ids, 5, FieldEntry{"faces", 17}, "cell");
  });
}

TEST(Checks, NameTheCoordinateThatIsNotFinite) {
  check_finite(Points{{0, 0, 0}, {1e308, 1e308, 1e308}}, "points");  // their sum is infinite
  expect_refused("points[1]: coordinate y is not a finite number", [] {
    check_finite(Points{{0, 0, 0}, {0, infinity, 0}}, "points");
  });
  expect_refused("points[0]: coordinate x is not a finite number", [] {
    check_finite(Points{{infinity, 0, 0}, {0, 0, 0}}, "points");
  });
  expect_refused("centre: coordinate z is not a finite number", [] {
    check_finite(Vec3{0, 0, std::numeric_limits<double>::quiet_NaN()}, "centre");
  });
}

TEST(Checks, NameTheLimitsOfARange) {
  check_range(1, 1, 8, "option workers");
  check_range(8, 1, 8, "option workers");
  expect_refused("option workers: 0 is out of range, allowed are 1 to 8", [] { check_range(0, 1, 8, "option workers"); });
  expect_refused("option workers: 9 is out of range, allowed are 1 to 8", [] { check_range(9, 1, 8, "option workers"); });
}

}  // namespace
}  // namespace deform::checks_test
