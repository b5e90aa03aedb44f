// The translation between Error and gRPC status, both ways.
#include "server/rpc/status.h"

#include <gtest/gtest.h>

#include <new>
#include <set>
#include <string>

#include "core/base/text.h"

namespace deform::server {
namespace {

constexpr ErrorCode all_codes[] = {ErrorCode::invalid_argument,    ErrorCode::not_found,         ErrorCode::already_exists,
                                   ErrorCode::failed_precondition, ErrorCode::out_of_budget,     ErrorCode::numerical_failure,
                                   ErrorCode::cancelled,           ErrorCode::deadline_exceeded, ErrorCode::data_loss,
                                   ErrorCode::unavailable,         ErrorCode::internal};

TEST(Status, EveryCodeSurvivesTheRoundTripAndHasItsOwnStatus) {
  std::set<grpc::StatusCode> used;
  for (const ErrorCode code : all_codes) {
    const grpc::Status status = to_status(Error(code, "handle \"roof\""));
    EXPECT_FALSE(status.ok());
    EXPECT_TRUE(used.insert(status.error_code()).second) << to_string(code);
    const Error back = to_error(status);
    EXPECT_EQ(back.code(), code);
    EXPECT_STREQ(back.what(), "handle \"roof\"");
    EXPECT_EQ(back.retry_after_ms(), 0u);
  }
}

TEST(Status, TheRetryHintComesFromTheTrailingMetadata) {
  const grpc::Status status = to_status(Error(ErrorCode::out_of_budget, "full", 1234));
  EXPECT_EQ(to_error(status, {{"retry-after-ms", "1234"}}).retry_after_ms(), 1234u);
  for (const char* nonsense : {"", "soon", "12x", "-5", "99999999999", " 7"}) {
    EXPECT_EQ(to_error(status, {{"retry-after-ms", nonsense}}).retry_after_ms(), 0u) << nonsense;
  }
}

TEST(Status, ForeignCodesBecomeTheNearestOfOurs) {
  EXPECT_EQ(to_error({grpc::StatusCode::UNIMPLEMENTED, ""}).code(), ErrorCode::failed_precondition);
  EXPECT_EQ(to_error({grpc::StatusCode::UNAUTHENTICATED, ""}).code(), ErrorCode::failed_precondition);
  EXPECT_EQ(to_error({grpc::StatusCode::OUT_OF_RANGE, ""}).code(), ErrorCode::invalid_argument);
  EXPECT_EQ(to_error({grpc::StatusCode::UNKNOWN, ""}).code(), ErrorCode::internal);
}

TEST(Status, LongMessagesAreCut) {
  const grpc::Status status = to_status(Error(ErrorCode::internal, std::string(100'000, 'x')));
  EXPECT_EQ(status.error_message().size(), max_status_message);
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
}  // namespace deform::server
