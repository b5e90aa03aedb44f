// SPDX-License-Identifier: GPL-3.0-or-later
// What client and server share: errors as they travel, encodings.
#include <gtest/gtest.h>

#include <set>
#include <string>

#include "proto/convert/base/block.h"
#include "proto/convert/base/error.h"
#include "tests/support/expect_error.h"

namespace deform::convert::base_test {
namespace {

constexpr ErrorCode all_codes[] = {
    ErrorCode::invalid_argument, ErrorCode::not_found,         ErrorCode::already_exists,  ErrorCode::failed_precondition,
    ErrorCode::out_of_budget,    ErrorCode::numerical_failure, ErrorCode::cancelled,       ErrorCode::deadline_exceeded,
    ErrorCode::data_loss,        ErrorCode::unavailable,       ErrorCode::unauthenticated, ErrorCode::permission_denied,
    ErrorCode::internal};

TEST(ConvertError, EveryCodeSurvivesTheRoundTripAndHasItsOwnStatus) {
  std::set<std::uint32_t> used;
  for (const ErrorCode code : all_codes) {
    const v1::RequestError message = error_to_proto({code, "handle \"roof\"", 7});
    EXPECT_TRUE(used.insert(message.code()).second) << to_string(code);
    const Error back = error_from_proto(message);
    EXPECT_EQ(back.code(), code);
    EXPECT_STREQ(back.what(), "handle \"roof\"");
    EXPECT_EQ(back.retry_after_ms(), 7u);
  }
}

TEST(ConvertError, ForeignStatusCodesBecomeTheNearestOfOurs) {
  EXPECT_EQ(error_code(12), ErrorCode::failed_precondition) << "UNIMPLEMENTED";
  EXPECT_EQ(error_code(16), ErrorCode::unauthenticated) << "UNAUTHENTICATED";
  EXPECT_EQ(error_code(7), ErrorCode::permission_denied) << "PERMISSION_DENIED";
  EXPECT_EQ(error_code(11), ErrorCode::invalid_argument) << "OUT_OF_RANGE";
  EXPECT_EQ(error_code(2), ErrorCode::internal) << "UNKNOWN";
  EXPECT_EQ(error_code(4'000'000'000u), ErrorCode::internal);
}

TEST(ConvertError, ARetryHintThatIsNoNumberIsNoHint) {
  EXPECT_EQ(retry_hint("1234"), 1234u);
  for (const char* nonsense : {"", "soon", "12x", "-5", "99999999999", " 7"}) EXPECT_EQ(retry_hint(nonsense), 0u) << nonsense;
}

TEST(ConvertError, MessagesAreMadePrintableAndCut) {
  EXPECT_EQ(error_to_proto({ErrorCode::internal, "a\nb"}).message(), "a\\x0ab");
  const std::string cut = error_to_proto({ErrorCode::internal, std::string(100'000, 'x')}).message();
  EXPECT_EQ(cut.size(), max_error_message);
  EXPECT_TRUE(cut.ends_with("xxx..."));
}

TEST(ConvertBlock, EveryEncodingComesBack) {
  for (const auto encoding : {v1::RAW_F64, v1::RAW_F32, v1::DRACO, v1::DELTA_ZSTD}) {
    EXPECT_EQ(encoding_to_proto(encoding_from_proto(encoding).value()), encoding) << v1::Encoding_Name(encoding);
  }
  EXPECT_EQ(encoding_from_proto(v1::ENCODING_DEFAULT), codec::Encoding::draco);
  EXPECT_FALSE(encoding_from_proto(static_cast<v1::Encoding>(99)));
}

TEST(ConvertBlock, BlocksComeBack) {
  codec::Block block;
  block.encoding = codec::Encoding::delta_zstd;
  block.fell_back = false;
  block.count = 5;
  block.step = 0.25;
  block.offset = {1, -2, 3};
  block.max_error = 0.125;
  block.checksum = 77;
  block.bytes = "bytes";
  v1::Block message;
  block_to_proto(codec::Block(block), message);
  v1::Block broken = message;
  const codec::Block back = block_from_proto(std::move(message));
  EXPECT_EQ(back.encoding, block.encoding);
  EXPECT_EQ(back.count, block.count);
  EXPECT_EQ(back.step, block.step);
  EXPECT_EQ(back.offset, block.offset);
  EXPECT_EQ(back.max_error, block.max_error);
  EXPECT_EQ(back.checksum, block.checksum);
  EXPECT_EQ(back.bytes, block.bytes);
  broken.add_offset(4);
  test::expect_error(ErrorCode::data_loss, {"4 offsets"}, [&] { block_from_proto(std::move(broken)); });
}

}  // namespace
}  // namespace deform::convert::base_test
