// SPDX-License-Identifier: GPL-3.0-or-later
// Setups in pieces: EstimateLarge, PrepareLarge and GetSetup.
#include <atomic>
#include <functional>
#include <utility>
#include <vector>

#include "tests/server/ended_with.h"
#include "tests/server/service_fixture.h"

namespace deform::server::service_large_setups_test {
namespace {

using grpc::StatusCode;
using support::eventually;

constexpr std::size_t piece_bytes = 700'000;

/// Above 1 MiB; `lists` of 2 MB each.
v1::Setup large_setup(int lists = 1) {
  constexpr std::uint32_t ids = 500'000;
  v1::Setup setup;
  setup.set_geometry("mesh");
  v1::Region& region = *setup.add_fixed();
  for (int i = 0; i < lists; ++i) {
    auto& list = *region.add_union_();
    for (std::uint32_t id = 0; id < ids; ++id) list.add_ids(2'097'152 + id);
  }
  return setup;
}

template <typename Request>
std::vector<Request> messages_of(const std::string& bytes) {
  std::vector<Request> messages;
  for (std::size_t sent = 0; sent < bytes.size(); sent += piece_bytes) {
    messages.emplace_back().set_setup(bytes.substr(sent, piece_bytes));
  }
  messages.at(0).mutable_header()->mutable_setup()->set_bytes(bytes.size());
  return messages;
}

class LargeSetups : public ServiceFixture {
 protected:
  LargeSetups() {
    engine.on_prepare = [this](const v1::PrepareRequest& request, const CallContext& call,
                               const std::function<void(const v1::Progress&)>& on_progress,
                               const std::function<void(Engine::Outcome<v1::SystemInfo>)>& on_done) {
      prepared = request;
      context = call;
      v1::Progress progress;
      progress.set_stage("factor");
      on_progress(progress);
      Engine::Outcome<v1::SystemInfo> outcome;
      outcome.value.emplace().set_id("system");
      if (answers) on_done(outcome);
    };
  }

  grpc::Status prepare(const std::vector<v1::PrepareLargeRequest>& messages, std::vector<v1::PrepareReply>* replies = nullptr) {
    grpc::ClientContext call;
    const auto stream = stub->PrepareLarge(&call);
    for (const auto& message : messages) {
      if (!stream->Write(message)) break;
    }
    stream->WritesDone();
    v1::PrepareReply reply;
    while (stream->Read(&reply)) {
      if (replies != nullptr) replies->push_back(reply);
    }
    return stream->Finish();
  }

  grpc::Status estimate(const std::vector<v1::EstimateLargeRequest>& messages, v1::EstimateReply& reply) {
    grpc::ClientContext call;
    const auto stream = stub->EstimateLarge(&call, &reply);
    for (const auto& message : messages) {
      if (!stream->Write(message)) break;
    }
    stream->WritesDone();
    return stream->Finish();
  }

  std::atomic<bool> answers{true};
  v1::PrepareRequest prepared;
  CallContext context;
};

TEST_P(LargeSetups, PreparesWhatItsPiecesSayTogether) {
  start();
  const v1::Setup setup = large_setup(3);
  auto messages = messages_of<v1::PrepareLargeRequest>(setup.SerializeAsString());
  ASSERT_GT(messages.size(), 5u);
  messages.insert(messages.begin(), messages[0]);
  messages[0].clear_setup();  // a header alone will do, too
  messages[1].clear_header();
  messages[0].mutable_header()->mutable_request()->set_omit_setup(true);
  std::vector<v1::PrepareReply> replies;
  EXPECT_THAT(prepare(messages, &replies), EndedWith(StatusCode::OK));
  EXPECT_EQ(prepared.setup().SerializeAsString(), setup.SerializeAsString());
  EXPECT_TRUE(prepared.omit_setup());
  ASSERT_FALSE(replies.empty());
  EXPECT_EQ(replies.back().system().id(), "system");
}

TEST_P(LargeSetups, EstimatesWhatItsPiecesSayTogether) {
  start();
  v1::EstimateReply reply;
  EXPECT_THAT(estimate(messages_of<v1::EstimateLargeRequest>(large_setup().SerializeAsString()), reply),
              EndedWith(StatusCode::OK));
  EXPECT_EQ(reply.system_id(), "of mesh");
}

TEST_P(LargeSetups, ASetupComesBackInPieces) {
  start();
  grpc::ClientContext call;
  v1::GetSetupRequest request;
  request.set_system_id(std::string(2'000'000, 'x'));  // the fake answers with it
  const auto stream = stub->GetSetup(&call, request);
  v1::SetupPiece piece;
  std::string bytes;
  int pieces = 0;
  for (; stream->Read(&piece); ++pieces) {
    EXPECT_LE(piece.ByteSizeLong(), std::size_t{1} << 20);
    bytes += piece.data();
  }
  EXPECT_THAT(stream->Finish(), EndedWith(StatusCode::OK));
  EXPECT_EQ(pieces, 3);
  v1::Setup setup;
  ASSERT_TRUE(setup.ParseFromString(bytes));
  EXPECT_EQ(setup.geometry().size(), 2'000'000u);
}

TEST_P(LargeSetups, WrongPiecesAreRefusedByName) {
  ServiceOptions options;
  options.max_setup_bytes = std::size_t{4} << 20;
  start(options);
  using Messages = std::vector<v1::PrepareLargeRequest>;
  const Messages good = messages_of<v1::PrepareLargeRequest>(large_setup().SerializeAsString());
  const auto changed = [&](const std::function<void(Messages&)>& change) {
    Messages messages = good;
    change(messages);
    return messages;
  };
  std::string parts = large_setup().SerializeAsString();
  while (parts.size() < 3'900'000) parts += std::string("\x22\x02\x4a\x00", 4);  // fixed regions: empty unions
  const std::vector<std::pair<Messages, std::string>> cases = {
      {{}, "before its header"},
      {changed([](Messages& m) { m.erase(m.begin()); }), "the first message must have the header"},
      {changed([](Messages& m) { m.push_back(m[0]); }), "header: sent twice"},
      {changed([](Messages& m) { m.pop_back(); }), "bytes that the header announced arrived"},
      {changed([](Messages& m) { m.push_back(m.back()); }), "more than the"},
      {changed([](Messages& m) { m[0].mutable_header()->clear_setup(); }), "header.setup.bytes: 0, expected 1 to 4194304"},
      {changed([](Messages& m) { m[0].mutable_header()->mutable_setup()->set_bytes(std::uint64_t{1} << 63); }),
       "header.setup.bytes: 9223372036854775808, expected 1 to 4194304"},
      {changed([](Messages& m) { m[0].mutable_header()->mutable_request()->mutable_setup(); }), "header.request.setup"},
      {changed([](Messages& m) { m.emplace_back(); }), "neither header nor setup"},
      {messages_of<v1::PrepareLargeRequest>("\x0a\xff" + std::string(100, 'x')), "are not a deform.v1.Setup"},
      {messages_of<v1::PrepareLargeRequest>(parts), "so many parts"},
  };
  for (const auto& [messages, words] : cases) {
    const grpc::Status status = prepare(messages);
    EXPECT_THAT(status, EndedWith(StatusCode::INVALID_ARGUMENT)) << words;
    EXPECT_THAT(status.error_message(), testing::HasSubstr(words));
    v1::EstimateReply reply;
    std::vector<v1::EstimateLargeRequest> same(messages.size());
    for (std::size_t i = 0; i < messages.size(); ++i) ASSERT_TRUE(same[i].ParseFromString(messages[i].SerializeAsString()));
    const grpc::Status estimated = estimate(same, reply);
    EXPECT_EQ(estimated.error_message(), status.error_message());
  }
  EXPECT_FALSE(prepared.has_setup()) << "the engine saw none of them";
  EXPECT_THAT(prepare(good), EndedWith(StatusCode::OK));
}

TEST_P(LargeSetups, ACancelReachesThePreparation) {
  answers = false;
  start();
  grpc::ClientContext call;
  const auto stream = stub->PrepareLarge(&call);
  for (const auto& message : messages_of<v1::PrepareLargeRequest>(large_setup().SerializeAsString())) stream->Write(message);
  stream->WritesDone();
  v1::PrepareReply reply;
  EXPECT_TRUE(stream->Read(&reply));
  EXPECT_TRUE(reply.has_progress());
  call.TryCancel();
  EXPECT_THAT(stream->Finish(), EndedWith(StatusCode::CANCELLED));
  EXPECT_TRUE(eventually([&] { return context.stop.stop_requested(); }));
}

/// A setup that was cut at a message boundary may be another valid setup.
TEST_P(LargeSetups, ACancelWhileItIsSentNeverPrepares) {
  start();
  const auto messages = messages_of<v1::PrepareLargeRequest>(large_setup(2).SerializeAsString());
  grpc::ClientContext call;
  const auto stream = stub->PrepareLarge(&call);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_TRUE(stream->Write(messages[i]));
  call.TryCancel();
  EXPECT_THAT(stream->Finish(), EndedWith(StatusCode::CANCELLED));
  server->running().stop(std::chrono::milliseconds(0));
  EXPECT_FALSE(prepared.has_setup());
}

}  // namespace

DEFORM_BOTH_TRANSPORTS(LargeSetups);

}  // namespace deform::server::service_large_setups_test
