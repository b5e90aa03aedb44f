// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <map>
#include <set>
#include <thread>

#include "client/client.h"
#include "client/design.h"
#include "tests/client/scripted_service.h"
#include "tests/support/expect_error.h"

namespace deform::session_test {
namespace {

using client::Client;
using client::ClientOptions;
using test::expect_error;
using test::ReplyScript;
using test::ScriptedService;

v1::DeformRequest raw_request(std::size_t designs = 1) {
  v1::DeformRequest request;
  request.set_system_id("system");
  request.mutable_output()->set_encoding(v1::RAW_F64);
  for (std::size_t d = 0; d < designs; ++d) request.add_designs();
  return request;
}

void keep(Client& client) { client.keep_points("geometry", std::make_shared<const Points>(test::registered_points(5000))); }

std::vector<v1::DeformReply> replies_to(const v1::DeformStreamRequest& message) {
  ReplyScript script;
  script.request_id = message.request_id();
  script.designs = static_cast<std::size_t>(message.request().designs_size());
  return test::replies(script);
}

void write_all(ScriptedService::Stream& stream, const std::vector<v1::DeformReply>& all) {
  for (const auto& reply : all) stream.Write(reply, grpc::WriteOptions());
}

v1::DeformReply error_reply(std::uint64_t id, grpc::StatusCode code, std::uint32_t retry_after_ms = 0) {
  v1::DeformReply reply;
  reply.set_request_id(id);
  reply.mutable_error()->set_code(static_cast<std::uint32_t>(code));
  reply.mutable_error()->set_message("told to");
  reply.mutable_error()->set_retry_after_ms(retry_after_ms);
  return reply;
}

TEST(Session, AnswersInAnyOrderInterleaved) {
  ScriptedService service;
  std::atomic<bool> clean_end{false};
  service.on_stream = [&](grpc::ServerContext&, ScriptedService::Stream& stream) {
    v1::DeformStreamRequest message;
    std::vector<std::vector<v1::DeformReply>> answers;
    while (answers.size() < 3 && stream.Read(&message)) answers.insert(answers.begin(), replies_to(message));
    std::size_t longest = 0;
    for (const auto& answer : answers) longest = std::max(longest, answer.size());
    for (std::size_t k = 0; k < longest; ++k) {
      for (const auto& answer : answers) {
        if (k < answer.size()) stream.Write(answer[k], grpc::WriteOptions());
      }
    }
    clean_end = !stream.Read(&message);
    return grpc::Status::OK;
  };
  Client client = service.client();
  keep(client);
  auto session = client.open_session();
  std::vector<std::future<client::DeformOutcome>> futures;
  for (std::size_t k = 1; k <= 3; ++k) futures.push_back(session->submit(raw_request(k)));
  session->finish();
  EXPECT_TRUE(clean_end);
  for (std::size_t k = 0; k < 3; ++k) {
    const auto outcome = futures[k].get();
    ASSERT_EQ(outcome.designs.size(), k + 1);
    for (std::size_t d = 0; d <= k; ++d) EXPECT_EQ(outcome.designs[d].points, test::deformed_points(5000, d));
  }
  expect_error(ErrorCode::failed_precondition, {"after finish"}, [&] { session->submit(raw_request()); });
}

TEST(Session, AnErrorEndsOneRequestOnly) {
  ScriptedService service;
  service.on_stream = [&](grpc::ServerContext&, ScriptedService::Stream& stream) {
    v1::DeformStreamRequest message;
    for (int k = 0; stream.Read(&message); ++k) {
      if (k == 1) {
        stream.Write(error_reply(message.request_id(), grpc::StatusCode::INVALID_ARGUMENT), grpc::WriteOptions());
      } else {
        write_all(stream, replies_to(message));
      }
    }
    return grpc::Status::OK;
  };
  Client client = service.client();
  keep(client);
  auto session = client.open_session();
  auto first = session->submit(raw_request());
  auto second = session->submit(raw_request());
  auto third = session->submit(raw_request());
  EXPECT_EQ(first.get().designs.size(), 1u);
  expect_error(ErrorCode::invalid_argument, {"told to"}, [&] { second.get(); });
  EXPECT_EQ(third.get().designs.size(), 1u);
}

TEST(Session, CorruptedReplyFailsItsRequestAndIsCancelledThere) {
  ScriptedService service;
  std::atomic<std::uint64_t> cancelled{0};
  service.on_stream = [&](grpc::ServerContext&, ScriptedService::Stream& stream) {
    v1::DeformStreamRequest message;
    for (int k = 0; stream.Read(&message); ++k) {
      if (message.cancel()) {
        cancelled = message.request_id();
        continue;
      }
      auto all = replies_to(message);
      if (k == 0) (*all[2].mutable_block()->mutable_data())[9] ^= 1;
      write_all(stream, all);
    }
    return grpc::Status::OK;
  };
  Client client = service.client();
  keep(client);
  auto session = client.open_session();
  auto first = session->submit(raw_request());
  expect_error(ErrorCode::data_loss, {"checksum"}, [&] { first.get(); });
  EXPECT_EQ(session->submit(raw_request()).get().designs.size(), 1u);
  session->finish();
  EXPECT_EQ(cancelled, 1u);
}

TEST(Session, RepeatsWhatWasRefusedWithAHint) {
  ScriptedService service;
  std::map<std::uint64_t, int> seen;
  service.on_stream = [&](grpc::ServerContext&, ScriptedService::Stream& stream) {
    v1::DeformStreamRequest message;
    while (stream.Read(&message)) {
      if (++seen[message.request_id()] <= 2) {
        stream.Write(error_reply(message.request_id(), grpc::StatusCode::RESOURCE_EXHAUSTED, 10), grpc::WriteOptions());
      } else {
        write_all(stream, replies_to(message));
      }
    }
    return grpc::Status::OK;
  };
  Client client = service.client();
  keep(client);
  auto session = client.open_session();
  std::vector<std::future<client::DeformOutcome>> futures;
  for (int k = 0; k < 4; ++k) futures.push_back(session->submit(raw_request()));
  for (auto& future : futures) EXPECT_EQ(future.get().designs.size(), 1u);
  session->finish();
  for (const auto& [id, times] : seen) EXPECT_EQ(times, 3) << id;
}

TEST(Session, ABrokenStreamFailsAllThatIsOpen) {
  ScriptedService service;
  service.on_stream = [&](grpc::ServerContext&, ScriptedService::Stream& stream) {
    v1::DeformStreamRequest message;
    for (int k = 0; k < 3; ++k) stream.Read(&message);
    return grpc::Status(grpc::StatusCode::UNAVAILABLE, "going down");
  };
  Client client = service.client();
  keep(client);
  auto session = client.open_session();
  std::vector<std::future<client::DeformOutcome>> futures;
  for (int k = 0; k < 3; ++k) futures.push_back(session->submit(raw_request()));
  for (auto& future : futures) expect_error(ErrorCode::unavailable, {"going down"}, [&] { future.get(); });
  auto late = session->submit(raw_request());
  expect_error(ErrorCode::unavailable, {"going down"}, [&] { late.get(); });
  session->finish();
}

TEST(Session, HoldsBackBeyondTheLimitInFlight) {
  ScriptedService service;
  std::atomic<int> received{0};
  std::atomic<bool> answer{false};
  service.on_stream = [&](grpc::ServerContext&, ScriptedService::Stream& stream) {
    v1::DeformStreamRequest message;
    std::vector<v1::DeformStreamRequest> waiting;
    while (static_cast<int>(waiting.size()) < 2 && stream.Read(&message)) {
      waiting.push_back(message);
      ++received;
    }
    while (!answer) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    for (const auto& one : waiting) write_all(stream, replies_to(one));
    while (stream.Read(&message)) write_all(stream, replies_to(message));
    return grpc::Status::OK;
  };
  ClientOptions options;
  options.max_in_flight = 2;
  Client client = service.client(options);
  keep(client);
  auto session = client.open_session();
  auto first = session->submit(raw_request());
  auto second = session->submit(raw_request());
  std::atomic<bool> third_submitted{false};
  std::future<client::DeformOutcome> third;
  std::thread submitter([&] {
    third = session->submit(raw_request());
    third_submitted = true;
  });
  while (received < 2) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_FALSE(third_submitted);
  answer = true;
  submitter.join();
  EXPECT_EQ(third.get().designs.size(), 1u);
}

TEST(Session, DestructionCancelsWhatIsOpen) {
  ScriptedService service;
  std::atomic<bool> saw_cancel{false};
  service.on_stream = [&](grpc::ServerContext& context, ScriptedService::Stream&) {
    while (!context.IsCancelled()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    saw_cancel = true;
    return grpc::Status(grpc::StatusCode::CANCELLED, "");
  };
  Client client = service.client();
  keep(client);
  auto session = client.open_session();
  auto future = session->submit(raw_request());
  session.reset();
  expect_error(ErrorCode::cancelled, {"cancelled"}, [&] { future.get(); });
  for (int k = 0; k < 1000 && !saw_cancel; ++k) std::this_thread::sleep_for(std::chrono::milliseconds(2));
  EXPECT_TRUE(saw_cancel);
}

TEST(Client, SendsLargeRequestsInSmallMessages) {
  ScriptedService service;
  v1::DeformRequest joined;
  service.on_stream = [&](grpc::ServerContext&, ScriptedService::Stream& stream) {
    v1::DeformStreamRequest message;
    bool more = true;
    std::uint64_t id = 0;
    while (more && stream.Read(&message)) {
      EXPECT_LT(message.ByteSizeLong(), std::size_t{1} << 20);
      id = message.request_id();
      joined.MergeFrom(message.request());
      more = message.more();
    }
    ReplyScript script;
    script.request_id = id;
    write_all(stream, test::replies(script));
    while (stream.Read(&message)) {
    }
    return grpc::Status::OK;
  };
  Client client = service.client();
  keep(client);
  auto request = raw_request();
  const Points displacements(200'000, Vec3{1, 2, 3});
  *request.mutable_designs(0)->add_motions() = client::displacement_motion("roof", displacements);
  EXPECT_EQ(client.deform(request).designs.at(0).points, test::deformed_points(5000, 0));
  std::size_t bytes = 0;
  for (const auto& design : joined.designs()) {
    for (const auto& motion : design.motions()) {
      EXPECT_EQ(motion.handle(), "roof");
      for (const auto& piece : motion.displacements()) {
        EXPECT_EQ(piece.first() * sizeof(Vec3), bytes);
        bytes += piece.xyz().size();
      }
    }
  }
  EXPECT_EQ(bytes, 200'000 * sizeof(Vec3));
}

}  // namespace
}  // namespace deform::session_test
