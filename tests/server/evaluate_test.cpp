// SPDX-License-Identifier: GPL-3.0-or-later
// Evaluate on the real engine through the real service: points that were never registered, order and limits of blocks, clients
// that send nonsense, stall, cancel or never read.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "core/codec/block.h"
#include "core/deformers/space_map.h"
#include "proto/convert/base/block.h"
#include "proto/convert/setup.h"
#include "server/engine/evaluate_call.h"
#include "tests/server/service_fixture.h"
#include "tests/server/test_mesh.h"

namespace deform::server::evaluate_test {
namespace {

using grpc::StatusCode;

class Evaluate : public testing::TestWithParam<support::Transport> {
 protected:
  Evaluate() : server(GetParam(), small_options()), stub(v1::DeformService::NewStub(server.channel())) {}

  static ServerOptions small_options() {
    ServerOptions options;
    options.engine.workers = 2;
    options.engine.memory_budget = std::size_t{1} << 30;
    return options;
  }

  void SetUp() override {
    const auto upload = server.engine().begin_upload(header_of(mesh), {});
    for (const auto& part : upload_messages(mesh)) upload->add(part);
    geometry = upload->finish();
    system = prepare(sheet_setup(geometry.id()));
  }
  std::string prepare(const v1::Setup& setup) {
    grpc::ClientContext context;
    v1::PrepareRequest request;
    *request.mutable_setup() = setup;
    const auto reader = stub->Prepare(&context, request);
    v1::PrepareReply reply;
    std::string id;
    while (reader->Read(&reply)) id = reply.system().id();
    const grpc::Status status = reader->Finish();
    EXPECT_TRUE(status.ok()) << status.error_message();
    return id;
  }

  v1::EvaluateRequest header(std::vector<double> variables = {0.2, 0.3}) const {
    v1::EvaluateRequest request;
    request.mutable_header()->set_system_id(system);
    request.mutable_header()->mutable_output()->set_encoding(v1::RAW_F64);
    for (const double v : variables) request.mutable_header()->mutable_design()->add_variables(v);
    return request;
  }
  static v1::EvaluateRequest block(const std::vector<Vec3>& points, std::uint32_t number, std::uint64_t first,
                                   codec::Encoding encoding = codec::Encoding::raw_f64) {
    v1::EvaluateRequest request;
    v1::Block& message = *request.mutable_points();
    message.set_block(number);
    message.set_first(first);
    convert::block_to_proto(codec::encode(points, points, {encoding, 0}), message);
    return request;
  }

  struct Answer {
    grpc::Status status;
    std::vector<Vec3> points;
    std::vector<v1::Block> blocks;
    std::optional<v1::EvaluateInfo> info;
    std::optional<v1::EvaluateResult> result;
  };
  /// Writes these messages, and reads what comes.
  Answer call(const std::vector<v1::EvaluateRequest>& messages) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(60));
    const auto stream = stub->Evaluate(&context);
    std::thread writer([&] {
      for (const auto& message : messages) {
        if (!stream->Write(message)) return;
      }
      stream->WritesDone();
    });
    Answer answer;
    v1::EvaluateReply reply;
    while (stream->Read(&reply)) {
      if (reply.has_info()) answer.info = reply.info();
      if (reply.has_result()) answer.result = reply.result();
      if (!reply.has_block()) continue;
      answer.blocks.push_back(reply.block());
      if (reply.block().encoding() != v1::RAW_F64) continue;
      const std::size_t before = answer.points.size();
      answer.points.resize(before + reply.block().count());
      std::memcpy(answer.points.data() + before, reply.block().data().data(), reply.block().data().size());
    }
    writer.join();
    answer.status = stream->Finish();
    return answer;
  }
  void expect_refused(const std::vector<v1::EvaluateRequest>& messages, const std::vector<std::string>& words,
                      StatusCode code = StatusCode::INVALID_ARGUMENT) {
    const Answer answer = call(messages);
    EXPECT_EQ(answer.status.error_code(), code) << answer.status.error_message();
    for (const auto& word : words)
      EXPECT_NE(answer.status.error_message().find(word), std::string::npos) << answer.status.error_message();
    EXPECT_FALSE(answer.result);
  }

  /// What the library gives.
  std::vector<Vec3> expected(const std::vector<Vec3>& points, const std::vector<double>& variables) const {
    const deform::Setup setup = convert::setup_from_proto(sheet_setup(geometry.id()), 100);
    std::vector<Vec3> out(points.size());
    const auto prepared = deform::prepare(std::make_shared<const Mesh>(mesh), setup);
    prepared->bind_in_space(Design{variables, {}}, {})->evaluate(points, 0, out, {});
    return out;
  }

  const Mesh mesh = sheet_mesh(31, 16);
  support::InProcessServer server;
  std::unique_ptr<v1::DeformService::Stub> stub;
  v1::GeometryInfo geometry;
  std::string system;
};

std::vector<Vec3> places(std::size_t count, double shift = 0.001) {
  std::vector<Vec3> points(count);
  for (std::size_t i = 0; i < count; ++i) {
    const auto t = static_cast<double>(i) / static_cast<double>(count);
    points[i] = {2 * t + shift, 0.5 + 0.4 * std::sin(40 * t), 0.1 * std::cos(17 * t)};
  }
  return points;
}

TEST_P(Evaluate, BlocksAreAnsweredInOrderBitForBit) {
  const std::vector<Vec3> points = places(100'000);
  std::vector<v1::EvaluateRequest> messages{header()};
  std::size_t first = 0;
  std::uint32_t number = 0;
  for (const std::size_t count : {1u, 40'000u, 17u, 3000u, 40'000u, 16'982u}) {
    messages.push_back(
        block({points.begin() + static_cast<std::ptrdiff_t>(first), points.begin() + static_cast<std::ptrdiff_t>(first + count)},
              number++, first));
    first += count;
  }
  const Answer answer = call(messages);
  ASSERT_TRUE(answer.status.ok()) << answer.status.error_message();
  ASSERT_TRUE(answer.info && answer.result);
  EXPECT_EQ(answer.info->geometry_id(), geometry.id());
  EXPECT_EQ(answer.info->most_points(), EvaluateCall::most_points);
  EXPECT_EQ(answer.points, expected(points, {0.2, 0.3}));
  EXPECT_EQ(answer.result->points(), points.size());
  EXPECT_TRUE(answer.result->converged());
  EXPECT_GT(answer.result->max_displacement(), 0.05);
  EXPECT_EQ(answer.result->max_error(), 0);
  std::vector<std::uint64_t> checksums;
  for (const auto& message : answer.blocks) {
    EXPECT_EQ(message.block(), checksums.size());
    checksums.push_back(message.checksum());
  }
  EXPECT_EQ(answer.result->checksum(), codec::fold_checksums(checksums));
}

TEST_P(Evaluate, RegisteredPointsGoWhereDeformPutsThem) {
  const Answer answer = call({header(), block(mesh.points, 0, 0)});
  ASSERT_TRUE(answer.status.ok()) << answer.status.error_message();
  grpc::ClientContext context;
  v1::DeformRequest request;
  request.set_system_id(system);
  *request.add_designs() = header().header().design();
  request.mutable_output()->set_encoding(v1::RAW_F64);
  request.set_path(v1::PATH_DIRECT);
  const auto reader = stub->Deform(&context, request);
  v1::DeformReply reply;
  std::vector<Vec3> points(mesh.points.size());
  double error = -1;
  while (reader->Read(&reply)) {
    if (reply.has_block()) {
      std::memcpy(points.data() + reply.block().first(), reply.block().data().data(), reply.block().data().size());
    }
    if (reply.has_result()) error = reply.result().estimated_error();
  }
  ASSERT_TRUE(reader->Finish().ok());
  EXPECT_EQ(answer.points, points);
  EXPECT_EQ(answer.result->estimated_error(), error);
  EXPECT_EQ(answer.result->reduction_error(), 0);
  EXPECT_EQ(answer.result->doubts_size(), 0);
}

/// As Deform does: few of the many held points are centres, and a handle is mirrored.
TEST_P(Evaluate, WhatIsDoubtfulWhateverTheErrorIsTold) {
  v1::Setup setup = sheet_setup(geometry.id());
  setup.mutable_method()->mutable_rbf()->set_reduction(v1::REDUCTION_RINGS);
  setup.mutable_method()->mutable_rbf()->set_reduction_rings(1);
  setup.mutable_handles(0)->clear_region();
  auto& box = *setup.mutable_handles(0)->mutable_region()->mutable_box();
  for (const double x : {0.6, -9., -9.}) box.add_min(x);
  for (int k = 0; k < 3; ++k) box.add_max(9);
  setup.mutable_variables(1)->clear_rotate();
  setup.mutable_variables(1)->mutable_scale()->add_axis(1);
  for (const double x : {0., 0.}) setup.mutable_variables(1)->mutable_scale()->add_axis(x);
  system = prepare(setup);
  const Answer answer = call({header({0.2, -2}), block(places(10), 0, 0)});
  ASSERT_TRUE(answer.status.ok()) << answer.status.error_message();
  grpc::ClientContext context;
  v1::DeformRequest request;
  request.set_system_id(system);
  *request.add_designs() = header({0.2, -2}).header().design();
  const auto reader = stub->Deform(&context, request);
  v1::DeformReply reply;
  v1::DesignResult result;
  while (reader->Read(&reply)) {
    if (reply.has_result()) result = reply.result();
  }
  ASSERT_TRUE(reader->Finish().ok());
  EXPECT_GT(answer.result->reduction_error(), 0);
  EXPECT_EQ(answer.result->reduction_error(), result.reduction_error());
  ASSERT_EQ(answer.result->doubts_size(), 2);
  EXPECT_NE(answer.result->doubts(0).find("\"right\" is mirrored by turn = -2"), std::string::npos) << answer.result->doubts(0);
  EXPECT_NE(answer.result->doubts(1).find("not all handle and fixed points are centres"), std::string::npos);
  for (const auto& doubt : answer.result->doubts()) {
    EXPECT_EQ(std::count(result.reasons().begin(), result.reasons().end(), doubt), 1) << doubt;
  }
}

TEST_P(Evaluate, FarAwayWhereTheMethodExtrapolatesItSaysSo) {
  std::vector<Vec3> points = places(50'000);
  const auto near = call({header(), block({points.begin(), points.begin() + 40'000}, 0, 0),
                          block({points.begin() + 40'000, points.end()}, 1, 40'000)});
  ASSERT_TRUE(near.result);
  EXPECT_TRUE(near.result->warnings().empty()) << near.result->warnings(0);
  points[45'678] = {1, 300, 0};  // the sheet ends at y = 1; D is sqrt(2)
  const auto far = call({header(), block({points.begin(), points.begin() + 40'000}, 0, 0),
                         block({points.begin() + 40'000, points.end()}, 1, 40'000)});
  ASSERT_TRUE(far.result);
  ASSERT_EQ(far.result->warnings_size(), 1);
  for (const char* words : {"point 45678 moves", "it lies 299 (2.1e+02 D) outside of the box of the mesh"}) {
    EXPECT_NE(far.result->warnings(0).find(words), std::string::npos) << far.result->warnings(0);
  }
}

TEST_P(Evaluate, EncodingsOfBothSides) {
  const std::vector<Vec3> points = places(5000);
  const Answer wide = call({header(), block(points, 0, 0)});
  std::vector<Vec3> rounded = points;
  for (Vec3& x : rounded) x = {static_cast<float>(x[0]), static_cast<float>(x[1]), static_cast<float>(x[2])};
  EXPECT_EQ(call({header(), block(points, 0, 0, codec::Encoding::raw_f32)}).points,
            call({header(), block(rounded, 0, 0)}).points);
  for (const v1::Encoding encoding : {v1::RAW_F32, v1::DRACO, v1::DELTA_ZSTD}) {
    v1::EvaluateRequest asked = header();
    asked.mutable_header()->mutable_output()->set_encoding(encoding);
    asked.mutable_header()->mutable_output()->set_tolerance(1e-6);
    Answer answer = call({asked, block(points, 0, 0)});
    ASSERT_TRUE(answer.status.ok()) << answer.status.error_message();
    ASSERT_EQ(answer.blocks.size(), 1u);
    EXPECT_EQ(answer.blocks[0].encoding(), encoding);
    std::vector<Vec3> moved(points.size());
    codec::decode(convert::block_from_proto(std::move(answer.blocks[0])), points, moved);
    double worst = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) worst = std::max(worst, std::abs(moved[i][k] - wide.points[i][k]));
    }
    EXPECT_LE(worst, 1.000001e-6) << encoding;
    EXPECT_EQ(answer.result->max_error(), worst);
  }
}

TEST_P(Evaluate, NoPointsAreAnAnswer) {
  const Answer answer = call({header()});
  ASSERT_TRUE(answer.status.ok()) << answer.status.error_message();
  ASSERT_TRUE(answer.result);
  EXPECT_EQ(answer.result->points(), 0u);
  EXPECT_EQ(answer.result->checksum(), codec::fold_checksums({}));
}

TEST_P(Evaluate, BadBlocksAreRefusedWithIndexAndLimit) {
  const std::vector<Vec3> points = places(100);
  const auto good = block(points, 0, 0);
  const auto with = [&](const std::function<void(v1::Block&)>& change, std::uint32_t number = 1, std::uint64_t first = 100) {
    auto message = block(points, number, first);
    change(*message.mutable_points());
    return message;
  };
  const auto nothing = [](v1::Block&) {};
  expect_refused({header(), good, with([](v1::Block& b) { b.set_count(0), b.clear_data(); })},
                 {"blocks[1].count", "0", "1..40000"});
  expect_refused({header(), block(places(40'001), 0, 0)}, {"blocks[0].count", "40001", "40000"});
  expect_refused({header(), good, with(nothing, 2)}, {"blocks[1].block", "2"});
  expect_refused({header(), good, with(nothing, 0, 0)}, {"blocks[1].block", "0"});
  expect_refused({header(), good, with(nothing, 1, 99)}, {"blocks[1].first", "99", "100"});
  expect_refused({header(), good, with([](v1::Block& b) { b.set_design(1); })}, {"blocks[1].design"});
  expect_refused({header(), good, with([](v1::Block& b) { b.set_encoding(v1::DRACO); })}, {"blocks[1].encoding", "RAW_F64"});
  expect_refused({header(), good, with([](v1::Block& b) { b.set_encoding(v1::ENCODING_DEFAULT); })}, {"blocks[1].encoding"});
  expect_refused({header(), good, with([](v1::Block& b) { b.mutable_data()->pop_back(); })}, {"blocks[1].data", "2399", "2400"});
  expect_refused({header(), good, with([](v1::Block& b) { b.set_count(4'000'000'000u); })}, {"blocks[1].count"});
  expect_refused({header(), good, with([](v1::Block& b) { b.set_checksum(b.checksum() + 1); })}, {"blocks[1]", "checksum"},
                 StatusCode::DATA_LOSS);
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    std::vector<Vec3> broken = points;
    broken[17][2] = bad;
    expect_refused({header(), good, block(broken, 1, 100)}, {"points[117]", "finite"});
  }
  std::vector<Vec3> far = points;
  far[17][2] = -1e300;
  expect_refused({header(), good, block(far, 1, 100)}, {"points[117]", "coordinate z", "1e+40"});
}

TEST_P(Evaluate, BadBeginningsAreRefused) {
  const auto good = block(places(100), 0, 0);
  expect_refused({}, {"header"});
  expect_refused({good}, {"first message", "header"});
  expect_refused({header(), header()}, {"second header"});
  expect_refused({header(), v1::EvaluateRequest()}, {"without points"});
  expect_refused({v1::EvaluateRequest()}, {"header"});
  expect_refused({header({0.2})}, {"variables", "1"});
  expect_refused({header({0.2, std::nan("")})}, {"variables[1]"});
  auto changed = header();
  changed.mutable_header()->set_system_id(std::string(64, '0'));
  expect_refused({changed, good}, {"unknown"}, StatusCode::NOT_FOUND);
  changed = header();
  changed.mutable_header()->mutable_output()->set_tolerance(-1);
  expect_refused({changed}, {"output.tolerance"});
  changed = header();
  changed.mutable_header()->set_solver_tolerance(1e-3);
  expect_refused({changed}, {"tolerance"});
  changed = header();
  changed.mutable_header()->mutable_design()->set_continues(true);
  expect_refused({changed}, {"continues"});
  changed = header({});
  auto* far = changed.mutable_header()->mutable_design()->add_motions();
  far->set_handle("right");
  for (const double entry : {1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 1e200}) far->add_affine(entry);
  expect_refused({changed, good}, {"design: points move by up to", "times the diagonal of the model"});
}

TEST_P(Evaluate, TheShellSaysWhyNot) {
  v1::Setup setup = sheet_setup(geometry.id());
  setup.mutable_method()->mutable_shell();
  system = prepare(setup);
  expect_refused({header(), block(places(10), 0, 0)}, {"shell", "faces"}, StatusCode::FAILED_PRECONDITION);
}

// The server reads ahead by its window only, so that a client that never reads comes to a stop, and its memory with it.
TEST_P(Evaluate, AClientThatNeverReadsIsNotReadFrom) {
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(60));
  const auto stream = stub->Evaluate(&context);
  ASSERT_TRUE(stream->Write(header()));
  const std::size_t before = server.engine().info().memory_in_use();
  std::atomic<std::uint32_t> written{0};
  std::thread writer([&] {
    const std::vector<Vec3> points = places(30'000);
    while (stream->Write(block(points, written, std::uint64_t{written} * 30'000))) ++written;
  });
  std::uint32_t last = 0;
  support::eventually([&] {  // until nothing has moved for a second
    last = written;
    std::this_thread::sleep_for(std::chrono::milliseconds(1000));
    return last > 0 && written == last;
  });
  EXPECT_LT(last, 60u) << "it would go on for ever";
  EXPECT_LT(server.engine().info().memory_in_use() - before, std::size_t{200} << 20);
  context.TryCancel();
  writer.join();
  v1::EvaluateReply reply;
  while (stream->Read(&reply)) {
  }
  EXPECT_EQ(stream->Finish().error_code(), StatusCode::CANCELLED);
  EXPECT_TRUE(support::eventually([&] { return server.engine().info().running() == 0; }));
}

TEST_P(Evaluate, MemoryIsGivenBackAndAskedForBefore) {
  const std::size_t before = server.engine().info().memory_in_use();
  ASSERT_TRUE(call({header(), block(places(1000), 0, 0)}).status.ok());
  EXPECT_TRUE(support::eventually([&] { return server.engine().info().memory_in_use() == before; }));
  expect_refused({header(), block({{0, 0, std::nan("")}}, 0, 0)}, {"points[0]"});
  EXPECT_TRUE(support::eventually([&] { return server.engine().info().memory_in_use() == before; }));
}

// A call holds the memory of the blocks that are there, and of one more: many may wait for their clients side by side.
TEST_P(Evaluate, CallsThatWaitForTheirClientsHoldLittle) {
  constexpr std::size_t mib = 1 << 20, streams = 30;
  const auto in_use = [&] { return server.engine().info().memory_in_use(); };
  const std::size_t before = in_use();
  std::vector<std::unique_ptr<grpc::ClientContext>> contexts;
  std::vector<std::unique_ptr<grpc::ClientReaderWriter<v1::EvaluateRequest, v1::EvaluateReply>>> open;
  v1::EvaluateReply reply;
  for (std::size_t i = 0; i < streams; ++i) {
    contexts.push_back(std::make_unique<grpc::ClientContext>());
    open.push_back(stub->Evaluate(contexts.back().get()));
    ASSERT_TRUE(open.back()->Write(header()));
    ASSERT_TRUE(open.back()->Read(&reply)) << i << " streams were let in";
  }
  const std::size_t idle = in_use() - before;
  EXPECT_GT(idle, streams * 4 * mib);
  EXPECT_LT(idle, streams * 8 * mib);
  const std::vector<Vec3> points = places(30'000);
  std::atomic<std::uint32_t> written{0};
  std::thread writer([&] {
    while (written < 20 && open[0]->Write(block(points, written, std::uint64_t{written} * points.size()))) ++written;
    open[0]->WritesDone();
  });
  EXPECT_TRUE(support::eventually([&] { return in_use() - before > idle + 15 * mib; })) << "its window opens";
  std::uint32_t answers = 0;
  while (open[0]->Read(&reply)) answers += reply.has_block();
  writer.join();
  EXPECT_TRUE(open[0]->Finish().ok());
  EXPECT_EQ(answers, 20u);
  // That holds for a call that goes on, too: when all is answered it holds as much as before.
  for (std::uint32_t b = 0; b < 3; ++b) ASSERT_TRUE(open[1]->Write(block(points, b, std::uint64_t{b} * points.size())));
  for (answers = 0; answers < 3 && open[1]->Read(&reply); answers += reply.has_block()) {
  }
  EXPECT_TRUE(support::eventually([&] { return in_use() - before < (streams - 1) * 8 * mib; }));
  for (const auto& context : contexts) context->TryCancel();
  EXPECT_TRUE(support::eventually([&] { return in_use() == before; }));
}

TEST_P(Evaluate, DeadlinesAndCancels) {
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::milliseconds(300));
  const auto stream = stub->Evaluate(&context);
  stream->Write(header());  // and then nothing
  v1::EvaluateReply reply;
  while (stream->Read(&reply)) {
  }
  EXPECT_EQ(stream->Finish().error_code(), StatusCode::DEADLINE_EXCEEDED);
  grpc::ClientContext cancelled;
  const auto other = stub->Evaluate(&cancelled);
  other->Write(header());
  ASSERT_TRUE(other->Read(&reply));
  cancelled.TryCancel();
  while (other->Read(&reply)) {
  }
  EXPECT_EQ(other->Finish().error_code(), StatusCode::CANCELLED);
  EXPECT_TRUE(support::eventually([&] { return server.engine().info().running() == 0; }));
}

TEST_P(Evaluate, ManyAtOnce) {
  const std::vector<Vec3> points = places(20'000);
  const std::vector<Vec3> wanted = expected(points, {0.2, 0.3});
  std::vector<std::thread> callers;
  std::atomic<int> right{0};
  for (int c = 0; c < 6; ++c) {
    callers.emplace_back([&] {
      std::vector<v1::EvaluateRequest> messages{header()};
      for (std::uint32_t b = 0; b < 20; ++b) {
        messages.push_back(block({points.begin() + 1000 * b, points.begin() + 1000 * (b + 1)}, b, 1000u * b));
      }
      if (call(messages).points == wanted) ++right;
    });
  }
  for (std::thread& caller : callers) caller.join();
  EXPECT_EQ(right, 6);
}

DEFORM_BOTH_TRANSPORTS(Evaluate);

}  // namespace
}  // namespace deform::server::evaluate_test
