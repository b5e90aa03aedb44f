// SPDX-License-Identifier: GPL-3.0-or-later
// What requests take in memory is known from their bytes, charged before they are parsed, and given back.
#include "server/rpc/held_requests.h"

#include <gtest/gtest.h>

#include <atomic>
#include <string>
#include <thread>
#include <vector>

#include "core/base/error.h"
#include "server/rpc/flood_guard.h"
#include "server/rpc/service_messages.h"

namespace deform::server::held_requests_test {
namespace {

grpc::ByteBuffer in_pieces(const std::string& bytes, std::size_t piece) {
  std::vector<grpc::Slice> slices;
  for (std::size_t at = 0; at < bytes.size(); at += piece) slices.emplace_back(bytes.substr(at, piece));
  return {slices.data(), slices.size()};
}

/// Parses the bytes and expects that what protobuf says of the result was foretold, and not more than four times as much.
template <typename Message>
void expect_foretold(const std::string& bytes) {
  Message message;
  ASSERT_TRUE(message.ParseFromString(bytes));
  for (const std::size_t piece : {bytes.size() + 1, std::size_t{7}}) {
    const std::size_t foretold = parsed_size(in_pieces(bytes, piece), *Message::descriptor(), std::size_t{1} << 40);
    EXPECT_GE(foretold, message.SpaceUsedLong());
    EXPECT_LE(foretold, 4 * message.SpaceUsedLong() + 1000);
  }
}

v1::DeformRequest designs(int count) {
  v1::DeformRequest request;
  request.set_system_id("an id");
  for (int i = 0; i < count; ++i) request.add_designs();
  return request;
}

TEST(ParsedSize, EmptyDesigns) {
  expect_foretold<v1::DeformRequest>(designs(10'000).SerializeAsString());
  expect_foretold<v1::DeformRequest>("");
}

TEST(ParsedSize, NumbersTextsAndBytes) {
  v1::DeformRequest request;
  for (int i = 0; i < 500; ++i) {
    v1::Design& design = *request.add_designs();
    for (int k = 0; k < 12; ++k) design.add_variables(k);
    v1::Motion& motion = *design.add_motions();
    motion.set_handle(std::string(40, 'h'));
    motion.add_displacements()->set_xyz(std::string(2400, '\0'));
  }
  expect_foretold<v1::DeformRequest>(request.SerializeAsString());
}

TEST(ParsedSize, NestedRegionsAndPackedIds) {
  v1::PrepareRequest request;
  v1::Region* region = request.mutable_setup()->add_fixed();
  for (int depth = 0; depth < 60; ++depth) region = region->mutable_complement();
  for (std::uint32_t i = 0; i < 100'000; ++i) region->add_ids(i % 128);  // a byte each
  expect_foretold<v1::PrepareRequest>(request.SerializeAsString());
}

TEST(ParsedSize, NumbersThatAreNotPacked) {
  std::string bytes;
  for (int i = 0; i < 10'000; ++i) bytes += "\x30\x07";  // Region.ids
  expect_foretold<v1::Region>(bytes);
}

TEST(ParsedSize, FieldsThatAreNotInTheContract) {
  std::string numbers, texts;
  for (int i = 0; i < 10'000; ++i) numbers += "\xf8\x07\x01";  // field 127
  for (int i = 0; i < 10'000; ++i)
    texts +=
        "\xfa\x07\x03"
        "abc";
  std::string one_text, fitting_texts, other_type, groups;
  one_text = "\xfa\x07\x10" + std::string(16, 'a');
  for (int i = 0; i < 10; ++i) fitting_texts += one_text;     // each in a string of room for 30
  for (int i = 0; i < 10'000; ++i) other_type += "\x10\x01";  // designs are no numbers
  for (int i = 0; i < 10; ++i) {
    groups += "\xfb\x07";  // a group of field 127
    for (int k = 0; k < 1000; ++k) groups += "\x08\x01";
    groups += "\xfc\x07";
  }
  for (const std::string& bytes : {numbers, texts, one_text, fitting_texts, other_type, groups}) {
    v1::DeformRequest message;
    ASSERT_TRUE(message.ParseFromString(bytes));
    EXPECT_GE(parsed_size(in_pieces(bytes, 1000), *v1::DeformRequest::descriptor(), std::size_t{1} << 40),
              message.SpaceUsedLong());
  }
}

TEST(ParsedSize, AnythingElseEndsSomewhere) {
  // Cut off, damaged, nested for ever: the parser refuses it, the measure only has to return.
  std::string deep;
  for (int i = 0; i < 300; ++i) deep = "\x62" + std::string(1, static_cast<char>(std::min<std::size_t>(deep.size(), 127))) + deep;
  const std::string good = designs(100).SerializeAsString();
  for (const std::string& bytes :
       {deep, good.substr(0, good.size() - 1), std::string("\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff"),
        std::string("\x12\xff\xff\xff\xff\x0f"), std::string("\x00", 1)}) {
    EXPECT_LT(parsed_size(in_pieces(bytes, 5), *v1::Region::descriptor(), std::size_t{1} << 40), std::size_t{1} << 20);
  }
}

TEST(ParsedSize, StopsWhereItIsEnough) {
  const std::string bytes = designs(1'000'000).SerializeAsString();
  const std::size_t found = parsed_size(in_pieces(bytes, bytes.size()), *v1::DeformRequest::descriptor(), 1 << 20);
  EXPECT_GT(found, std::size_t{1} << 20);
  EXPECT_LT(found, std::size_t{1} << 21);
}

TEST(HeldRequests, SharesComeBackAndLargeOnesLeaveRoomForSmallOnes) {
  HeldRequests::Held outlives;
  {
    HeldRequests held(1 << 20);
    auto large = held.take(900'000);
    EXPECT_EQ(held.in_use(), 900'000u);
    EXPECT_THROW(held.take(100'000), Error) << "an eighth is for small ones";
    std::vector<HeldRequests::Held> small;
    for (int i = 0; i < 2; ++i) small.push_back(held.take(60'000));
    try {
      held.take(60'000);
      FAIL() << "beyond the limit";
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::out_of_budget);
      EXPECT_GT(error.retry_after_ms(), 0u);
      EXPECT_EQ(error.refusal(), Refusal::held);
    }
    large = {};
    EXPECT_EQ(held.in_use(), 120'000u);
    small.clear();
    EXPECT_EQ(held.in_use(), 0u);
    outlives = held.take(10);
  }
  EXPECT_EQ(outlives.bytes(), 10u);
}

TEST(HeldRequests, WhatNeverFitsIsNotToBeTriedAgain) {
  HeldRequests held(1 << 20);
  try {
    held.take(1 << 20);
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::out_of_budget);
    EXPECT_EQ(error.retry_after_ms(), 0u);
    EXPECT_EQ(error.refusal(), Refusal::held);
  }
}

TEST(HeldRequests, CountForTheirTenantToo) {
  TenantMeters meters;
  const TenantShare acme{"acme", meters.of("acme"), 1 << 20};
  HeldRequests held(1 << 24);
  {
    auto first = held.take(1'000'000, acme);
    EXPECT_THROW(held.take(100'000, acme), Error);
    EXPECT_EQ(held.in_use(), 1'000'000u) << "what is refused holds nothing";
    EXPECT_NO_THROW(held.take(100'000));
    HeldRequests::Held moved(std::move(first)), small = held.take(60'000, acme);
    EXPECT_EQ(acme.meter->in_use(), 1'060'000u);
    first = std::move(moved);
    EXPECT_EQ(acme.meter->in_use(), 1'060'000u);
  }
  EXPECT_EQ(acme.meter->in_use(), 0u);
  EXPECT_THROW(held.take(15'000'000, {"b", meters.of("b"), 1 << 24}), Error) << "more than all may take";
  EXPECT_EQ(meters.of("b")->in_use(), 0u);
}

TEST(HeldRequests, AMessageOfTooManyPartsIsRefused) {
  HeldRequests held(0);
  const std::string bytes(4'000'000, '\0');
  std::string empty_designs;
  for (int i = 0; i < 2'000'000; ++i) empty_designs.append("\x12\x00", 2);
  try {
    held.take(in_pieces(empty_designs, 100'000), *v1::DeformRequest::descriptor());
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::invalid_argument);
  }
  EXPECT_EQ(held.in_use(), 0u);
  const auto fits = held.take(in_pieces(designs(10'000).SerializeAsString(), 1000), *v1::DeformRequest::descriptor());
  EXPECT_GT(fits.bytes(), 10'000 * sizeof(v1::Design));
}

TEST(DeformStreamRequest, IsKnownWithoutItsRequest) {
  v1::DeformStreamRequest message;
  message.set_request_id(77);
  message.set_more(true);
  *message.mutable_request() = designs(100);
  const std::string bytes = message.SerializeAsString();
  const v1::DeformStreamRequest known = without_request(in_pieces(bytes, 9));
  message.clear_request();
  EXPECT_EQ(known.SerializeAsString(), message.SerializeAsString());
  EXPECT_THROW(without_request(in_pieces(bytes.substr(0, bytes.size() - 3), 1000)), Error);
}

TEST(FloodGuard, ToldOncePerConnectionThatResetsTooManyCalls) {
  FloodGuard guard;
  std::vector<std::string> told;
  guard.on_flood([&](const std::string& peer) { told.push_back(peer); });
  for (int i = 0; i < FloodGuard::most_resets - 1; ++i) {
    guard.note_reset("a");
    guard.note_reset("b");
  }
  EXPECT_TRUE(told.empty());
  for (int i = 0; i < 10; ++i) guard.note_reset("b");
  EXPECT_EQ(told, std::vector<std::string>{"b"});
}

}  // namespace
}  // namespace deform::server::held_requests_test
