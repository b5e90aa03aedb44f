#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/base/error.h"

namespace deform::test {

/// Runs `action` and expects Error(code) whose message contains every one of `parts`.
template <typename Action>
void expect_error(ErrorCode code, std::initializer_list<const char*> parts, const Action& action) {
  try {
    action();
  } catch (const Error& error) {
    EXPECT_STREQ(to_string(error.code()), to_string(code)) << error.what();
    for (const char* part : parts) EXPECT_THAT(error.what(), testing::HasSubstr(part));
    return;
  }
  ADD_FAILURE() << "no error; expected one about " << (parts.size() ? *parts.begin() : "anything");
}

}  // namespace deform::test
