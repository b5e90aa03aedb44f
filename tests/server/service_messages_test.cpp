// SPDX-License-Identifier: GPL-3.0-or-later
// Bytes on the wire: what we write without copying must be what protobuf would have written.
#include "server/rpc/service_messages.h"

#include <gtest/gtest.h>

#include <string>

#include "core/base/error.h"

namespace deform::server::service_messages_test {
namespace {

std::string bytes_of(const grpc::ByteBuffer& buffer) {
  grpc::Slice slice;
  EXPECT_TRUE(buffer.DumpToSingleSlice(&slice).ok());
  return {slice.begin(), slice.end()};
}

v1::DeformReply block_reply(std::size_t data_size, std::uint64_t request_id) {
  v1::DeformReply reply;
  reply.set_request_id(request_id);
  v1::Block& block = *reply.mutable_block();
  block.set_design(3);
  block.set_block(7);
  block.set_first(7 << 15);
  block.set_count(32768);
  block.set_encoding(v1::DRACO);
  block.set_step(1e-6);
  for (const int o : {-5, 0, 1 << 30}) block.add_offset(o);
  block.set_max_error(4.9e-7);
  block.set_checksum(0xfedcba9876543210u);
  block.set_data(std::string(data_size, '\xA5'));
  return reply;
}

TEST(Messages, BlocksAreWrittenAsProtobufWouldWriteThem) {
  for (const std::size_t size : {0, 1, 127, 128, 16383, 16384, 900'000}) {
    for (const std::uint64_t id : {std::uint64_t{0}, std::uint64_t{1}, ~std::uint64_t{0}}) {
      v1::DeformReply reply = block_reply(size, id);
      const std::string expected = reply.SerializeAsString();
      EXPECT_EQ(bytes_of(serialized(std::move(reply))), expected) << size << " bytes, request " << id;
    }
  }
}

TEST(Messages, OtherRepliesToo) {
  v1::DeformReply reply;
  reply.set_request_id(4);
  reply.mutable_summary()->set_bytes(12);
  const std::string expected = reply.SerializeAsString();
  EXPECT_EQ(bytes_of(serialized(std::move(reply))), expected);
  EXPECT_EQ(bytes_of(serialized(v1::DeformReply())), "");
}

TEST(Messages, ChunksOfPointsKeepTheirPointsAlive) {
  auto points = std::make_shared<const Points>(Points{{1, 2, 3}, {4, 5, 6}, {7, 8, 9}});
  const std::weak_ptr<const Points> watch = points;
  v1::PointChunk expected;
  expected.set_xyz(points->data() + 1, 2 * sizeof(Vec3));
  {
    const grpc::ByteBuffer buffer = serialized_chunk(points, 1, 3);
    points.reset();
    EXPECT_FALSE(watch.expired());
    EXPECT_EQ(bytes_of(buffer), expected.SerializeAsString());
  }
  EXPECT_TRUE(watch.expired());
}

TEST(Messages, ParsingNeedsAllBytesInAnyNumberOfSlices) {
  const std::string bytes = block_reply(1000, 9).SerializeAsString();
  for (std::size_t cut = 0; cut <= bytes.size(); cut += 97) {
    const grpc::Slice slices[] = {grpc::Slice(bytes.substr(0, cut)), grpc::Slice(bytes.substr(cut))};
    v1::DeformReply reply;
    parse(grpc::ByteBuffer(slices, 2), reply);
    EXPECT_EQ(reply.SerializeAsString(), bytes);
  }
  const grpc::Slice half(bytes.substr(0, bytes.size() / 2));
  v1::DeformReply reply;
  try {
    parse(grpc::ByteBuffer(&half, 1), reply);
    FAIL() << "half a message";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::invalid_argument);
    EXPECT_NE(std::string(error.what()).find("deform.v1.DeformReply"), std::string::npos);
  }
}

}  // namespace
}  // namespace deform::server::service_messages_test
