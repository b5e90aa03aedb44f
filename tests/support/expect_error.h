// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <vector>

#include "core/base/error.h"

namespace deform::test {

/// Runs `action` and expects Error(code) whose message contains every one of `parts`.
template <typename Action>
void expect_error(ErrorCode code, const std::vector<const char*>& parts, const Action& action) {
  try {
    action();
  } catch (const Error& error) {
    EXPECT_STREQ(to_string(error.code()), to_string(code)) << error.what();
    for (const char* part : parts) EXPECT_THAT(error.what(), testing::HasSubstr(part));
    return;
  }
  ADD_FAILURE() << "no error; expected one about " << (parts.empty() ? "anything" : parts[0]);
}

}  // namespace deform::test
