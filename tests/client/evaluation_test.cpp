// SPDX-License-Identifier: GPL-3.0-or-later
// Client::evaluate() against a server that the tests play: what it sends, what it believes, and how it ends.
#include <gtest/gtest.h>

#include <functional>
#include <stdexcept>
#include <vector>

#include "client/client.h"
#include "core/codec/block.h"
#include "tests/client/scripted_service.h"
#include "tests/support/expect_error.h"

namespace deform::evaluation_test {
namespace {

using client::Client;
using test::expect_error;
using test::ScriptedService;
using Stream = grpc::ServerReaderWriterInterface<v1::EvaluateReply, v1::EvaluateRequest>;

v1::EvaluateHeader raw_header() {
  v1::EvaluateHeader header;
  header.set_system_id("system");
  header.mutable_output()->set_encoding(v1::RAW_F64);
  return header;
}

std::vector<Vec3> lifted(std::vector<Vec3> points) {
  for (Vec3& x : points) x[2] += 1;
  return points;
}

/// Lifts every point by one. change(reply, number of the block) may spoil an answer, the result has the number -1.
grpc::Status lift(Stream& stream, const std::function<void(v1::EvaluateReply&, int)>& change = {}) {
  v1::EvaluateRequest request;
  if (!stream.Read(&request) || !request.has_header()) return {grpc::StatusCode::INVALID_ARGUMENT, "no header"};
  v1::EvaluateReply reply;
  reply.mutable_info()->set_geometry_id("geometry");
  stream.Write(reply, {});
  codec::ChecksumFold fold;
  std::uint64_t points = 0;
  int number = 0;
  while (stream.Read(&request)) {
    const v1::Block& from = request.points();
    codec::Block block;
    block.count = from.count();
    block.checksum = from.checksum();
    block.bytes = from.data();
    std::vector<Vec3> in(from.count());
    codec::decode(block, in, in);
    block = codec::encode(in, lifted(in), {codec::Encoding::raw_f64, 0});
    reply.Clear();
    v1::Block& to = *reply.mutable_block();
    to.set_block(from.block());
    to.set_first(from.first());
    to.set_count(block.count);
    to.set_encoding(v1::RAW_F64);
    to.set_checksum(block.checksum);
    to.set_data(block.bytes);
    fold.add(block.checksum);
    points += block.count;
    if (change) change(reply, number);
    stream.Write(reply, {});
    ++number;
  }
  reply.Clear();
  reply.mutable_result()->set_points(points);
  reply.mutable_result()->set_checksum(fold.value());
  if (change) change(reply, -1);
  stream.Write(reply, {});
  return grpc::Status::OK;
}

std::vector<Vec3> some_points(std::size_t count) {
  std::vector<Vec3> points(count);
  for (std::size_t i = 0; i < count; ++i) points[i] = {static_cast<double>(i), 0.5, -1};
  return points;
}

TEST(ClientEvaluate, SendsBlocksInOrderAndPutsAnswersTogether) {
  ScriptedService service;
  service.on_evaluate = [](grpc::ServerContext&, Stream& stream) { return lift(stream); };
  Client client = service.client();
  for (const std::size_t count : {0u, 1u, 32'768u, 100'000u}) {
    const std::vector<Vec3> points = some_points(count);
    std::vector<Vec3> out(count);
    EXPECT_EQ(client.evaluate(raw_header(), points, out).points(), count);
    EXPECT_EQ(out, lifted(points));
    std::vector<Vec3> same = points;
    client.evaluate(raw_header(), same, same);
    EXPECT_EQ(same, out) << "in place";
  }
  std::vector<Vec3> small(3);
  expect_error(ErrorCode::invalid_argument, {"3", "5"}, [&] { client.evaluate(raw_header(), some_points(5), small); });
}

TEST(ClientEvaluate, BelievesNothing) {
  const auto refused = [](const std::vector<const char*>& words, const std::function<void(v1::EvaluateReply&, int)>& change) {
    ScriptedService service;
    service.on_evaluate = [&](grpc::ServerContext&, Stream& stream) { return lift(stream, change); };
    Client client = service.client();
    std::vector<Vec3> out(100'000);
    expect_error(ErrorCode::data_loss, words, [&] { client.evaluate(raw_header(), some_points(100'000), out); });
  };
  const auto second = [](const std::function<void(v1::Block&)>& change) {
    return [change](v1::EvaluateReply& reply, int number) {
      if (number == 1) change(*reply.mutable_block());
    };
  };
  refused({"block 2"}, second([](v1::Block& b) { b.set_block(2); }));
  refused({"block 1"}, second([](v1::Block& b) { b.set_first(5); }));
  refused({"block 1"}, second([](v1::Block& b) { b.set_count(7); }));
  refused({"block 1"}, second([](v1::Block& b) { b.set_design(1); }));
  refused({"encoding"}, second([](v1::Block& b) { b.set_encoding(v1::DRACO); }));
  refused({"checksum"}, second([](v1::Block& b) { (*b.mutable_data())[17] ^= 1; }));
  refused({"block"}, second([](v1::Block& b) { b.mutable_data()->pop_back(); }));
  refused({"header"}, [](v1::EvaluateReply& reply, int number) {
    if (number == 1) reply.mutable_info();
  });
  refused({"checksum"}, [](v1::EvaluateReply& reply, int number) {
    if (number == -1) reply.mutable_result()->set_checksum(1);
  });
  refused({"99999"}, [](v1::EvaluateReply& reply, int number) {
    if (number == -1) reply.mutable_result()->set_points(99'999);
  });
  refused({"before its result"}, [](v1::EvaluateReply& reply, int number) {
    if (number == -1) reply.Clear();
  });
}

TEST(ClientEvaluate, EndsWithTheStatusOfTheServer) {
  ScriptedService service;
  service.on_evaluate = [](grpc::ServerContext&, Stream& stream) {
    v1::EvaluateRequest request;
    stream.Read(&request);
    return grpc::Status(grpc::StatusCode::FAILED_PRECONDITION, "only on the mesh");
  };
  Client client = service.client();
  std::vector<Vec3> out(500'000);
  expect_error(ErrorCode::failed_precondition, {"only on the mesh"},
               [&] { client.evaluate(raw_header(), some_points(500'000), out); });
}

TEST(ClientEvaluate, WhatSourceOrSinkThrowIsThrown) {
  ScriptedService service;
  service.on_evaluate = [](grpc::ServerContext&, Stream& stream) { return lift(stream); };
  Client client = service.client();
  const auto nothing = [](std::uint64_t, std::span<const Vec3>) {};
  EXPECT_THROW(client.evaluate(
                   raw_header(), [](std::span<Vec3>) -> std::size_t { throw std::out_of_range("source"); }, nothing),
               std::out_of_range);
  EXPECT_THROW(client.evaluate(
                   raw_header(), [](std::span<Vec3> block) { return block.size(); },
                   [](std::uint64_t, std::span<const Vec3>) { throw std::out_of_range("sink"); }),
               std::out_of_range);
  expect_error(ErrorCode::invalid_argument, {"source"}, [&] {
    client.evaluate(
        raw_header(), [](std::span<Vec3> block) { return block.size() + 1; }, nothing);
  });
}

TEST(ClientEvaluate, IsRepeatedWhereItMayBe) {
  ScriptedService service;
  int calls = 0;
  service.on_evaluate = [&](grpc::ServerContext& context, Stream& stream) {
    if (++calls < 3) {
      context.AddTrailingMetadata("retry-after-ms", "1");
      return grpc::Status(grpc::StatusCode::RESOURCE_EXHAUSTED, "full");
    }
    return lift(stream);
  };
  Client client = service.client();
  std::vector<Vec3> out(10);
  client.evaluate(raw_header(), some_points(10), out);
  EXPECT_EQ(out, lifted(some_points(10)));
  EXPECT_EQ(calls, 3);
}

}  // namespace
}  // namespace deform::evaluation_test
