// SPDX-License-Identifier: GPL-3.0-or-later
// Errors as gRPC statuses.
#include "server/rpc/status.h"

#include <gtest/gtest.h>

#include <new>
#include <string>
#include <utility>

#include "core/base/text.h"
#include "proto/convert/base/error.h"

namespace deform::server::status_test {
namespace {

// By name, so that the numbers of proto/convert are held against gRPC's own.
TEST(Status, EveryErrorHasItsStatus) {
  const std::pair<ErrorCode, grpc::StatusCode> table[] = {{ErrorCode::invalid_argument, grpc::StatusCode::INVALID_ARGUMENT},
                                                          {ErrorCode::not_found, grpc::StatusCode::NOT_FOUND},
                                                          {ErrorCode::already_exists, grpc::StatusCode::ALREADY_EXISTS},
                                                          {ErrorCode::failed_precondition, grpc::StatusCode::FAILED_PRECONDITION},
                                                          {ErrorCode::out_of_budget, grpc::StatusCode::RESOURCE_EXHAUSTED},
                                                          {ErrorCode::numerical_failure, grpc::StatusCode::ABORTED},
                                                          {ErrorCode::cancelled, grpc::StatusCode::CANCELLED},
                                                          {ErrorCode::deadline_exceeded, grpc::StatusCode::DEADLINE_EXCEEDED},
                                                          {ErrorCode::data_loss, grpc::StatusCode::DATA_LOSS},
                                                          {ErrorCode::unavailable, grpc::StatusCode::UNAVAILABLE},
                                                          {ErrorCode::internal, grpc::StatusCode::INTERNAL}};
  for (const auto& [code, number] : table) {
    const grpc::Status status = to_status(Error(code, "handle \"roof\""));
    EXPECT_EQ(status.error_code(), number) << to_string(code);
    EXPECT_EQ(status.error_message(), "handle \"roof\"");
  }
}

TEST(Status, ClientsAreToldWhatIsMeantForThem) {
  const Error error = Error(ErrorCode::unavailable, "cannot read /srv/data/a", 7).with_public_message("cannot read a");
  EXPECT_STREQ(error.what(), "cannot read /srv/data/a");
  EXPECT_EQ(to_status(error).error_message(), "cannot read a");
  EXPECT_EQ(convert::error_to_proto(error).message(), "cannot read a");
  EXPECT_EQ(convert::error_to_proto(error).retry_after_ms(), 7u);
}

TEST(Status, LongMessagesAreCut) {
  const grpc::Status status = to_status(Error(ErrorCode::internal, std::string(100'000, 'x')));
  EXPECT_EQ(status.error_message().size(), convert::max_error_message);
  EXPECT_TRUE(status.error_message().ends_with("xxx..."));
}

TEST(Status, WhatABodyThrowsComesBackAsAValue) {
  EXPECT_FALSE(caught([] {}));
  EXPECT_EQ(caught([] { throw Error(ErrorCode::not_found, "x", 3); })->retry_after_ms(), 3u);
  EXPECT_EQ(caught([] { throw std::bad_alloc(); })->code(), ErrorCode::out_of_budget);
  EXPECT_EQ(caught([] { throw std::runtime_error("why"); })->code(), ErrorCode::internal);
  EXPECT_EQ(caught([] { throw 1; })->code(), ErrorCode::internal);
}

TEST(Escaped, KeepsTextAndShowsWhatIsNotText) {
  EXPECT_EQ(escaped("Dach \"\xC3\xBC\" \xF0\x9F\x9A\x97", 100), "Dach \"\xC3\xBC\" \xF0\x9F\x9A\x97");
  EXPECT_EQ(escaped(std::string_view("a\0b\r\n\x1b[31m\x7f", 11), 100), "a\\x00b\\x0d\\x0a\\x1b[31m\\x7f");
  EXPECT_EQ(escaped("back\\slash", 100), "back\\x5cslash");
  // lone continuation, truncated, overlong, surrogate, beyond Unicode
  EXPECT_EQ(escaped("\xE2\x80\xAE.obj", 100), "\\u{202e}.obj");
  EXPECT_EQ(escaped("\x80", 100), "\\x80");
  EXPECT_EQ(escaped("\xE2\x82", 100), "\\xe2\\x82");
  EXPECT_EQ(escaped("\xC0\xAF", 100), "\\xc0\\xaf");
  EXPECT_EQ(escaped("\xE0\x80\xAF", 100), "\\xe0\\x80\\xaf");
  EXPECT_EQ(escaped("\xED\xA0\x80", 100), "\\xed\\xa0\\x80");
  EXPECT_EQ(escaped("\xF4\x90\x80\x80", 100), "\\xf4\\x90\\x80\\x80");
}

TEST(Escaped, CutsBetweenCharacters) {
  EXPECT_EQ(escaped("abcdef", 6), "abcdef");
  EXPECT_EQ(escaped("abcdefg", 6), "abc...");
  EXPECT_EQ(escaped("ab\xC3\xBC\xC3\xBC\xC3\xBC", 7), "ab\xC3\xBC...");
  EXPECT_EQ(escaped("ab\n\n", 7), "ab...");
  EXPECT_EQ(escaped("abcdef", 2), "..");
}

}  // namespace
}  // namespace deform::server::status_test
