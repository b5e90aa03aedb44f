// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/base/problems.h"

#include <gtest/gtest.h>

#include "tests/support/expect_error.h"

namespace deform::problems_test {
namespace {

void fail(ErrorCode code, const char* message) { throw Error(code, message); }

TEST(Problems, CollectWhatTheCallerGotWrong) {
  Problems problems(Problems::Mode::collect);
  EXPECT_TRUE(problems.check("a", [] {}));
  EXPECT_TRUE(problems.empty());
  EXPECT_FALSE(problems.check("handles[1].region", [] { fail(ErrorCode::invalid_argument, "no points"); }));
  EXPECT_FALSE(problems.check("file", [] { fail(ErrorCode::not_found, "no file"); }));
  ASSERT_EQ(problems.list().size(), 2u);
  EXPECT_EQ(problems.list()[0].field, "handles[1].region");
  EXPECT_EQ(problems.list()[0].message, "no points");
  EXPECT_EQ(problems.list()[1].message, "no file");
  test::expect_error(ErrorCode::internal, {"bug"}, [&] { problems.check("b", [] { fail(ErrorCode::internal, "bug"); }); });
  test::expect_error(ErrorCode::cancelled, {"stop"}, [&] { problems.check("b", [] { fail(ErrorCode::cancelled, "stop"); }); });
  EXPECT_EQ(problems.list().size(), 2u);
}

TEST(Problems, ConcernWholeEntriesByTheirParts) {
  Problems problems(Problems::Mode::collect);
  problems.check("handles[1].region", [] { fail(ErrorCode::invalid_argument, ""); });
  problems.check("constraints[12].regions[3]", [] { fail(ErrorCode::invalid_argument, ""); });
  EXPECT_TRUE(problems.concern("handles[1]"));
  EXPECT_TRUE(problems.concern("handles[1].region"));
  EXPECT_TRUE(problems.concern("handles"));
  EXPECT_FALSE(problems.concern("handles[1].name"));
  EXPECT_FALSE(problems.concern("handle"));
  EXPECT_FALSE(problems.concern("handles[11]"));
  EXPECT_TRUE(problems.concern("constraints[12].regions"));
  EXPECT_FALSE(problems.concern("constraints[1]"));
}

TEST(Problems, ThrowTheFirst) {
  Problems problems(Problems::Mode::throw_first);
  EXPECT_TRUE(problems.check("a", [] {}));
  test::expect_error(ErrorCode::invalid_argument, {"first"},
                     [&] { problems.check("a", [] { fail(ErrorCode::invalid_argument, "first"); }); });
  EXPECT_TRUE(problems.empty());
}

}  // namespace
}  // namespace deform::problems_test
