// SPDX-License-Identifier: GPL-3.0-or-later
// Calls with one request and one reply, and what surrounds every call: errors, limits, health, reflection.
#include <grpcpp/generic/generic_stub.h>

#include <condition_variable>
#include <functional>
#include <future>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

#include "server/rpc/reactors.h"
#include "server/rpc/status.h"
#include "tests/server/ended_with.h"
#include "tests/server/service_fixture.h"

namespace deform::server::service_unary_test {
namespace {

using grpc::StatusCode;

class ServiceUnary : public ServiceFixture {
 protected:
  grpc::Status get_geometry(const std::string& id) {
    v1::GetGeometryRequest request;
    request.set_id(id);
    grpc::ClientContext context;
    const grpc::Status status = stub->GetGeometry(&context, request, &info);
    hint = retry_hint(context);
    return status;
  }
  v1::GeometryInfo info;
  std::string hint;
};

TEST_P(ServiceUnary, CallsEndByTheTimeThatTheServerAllows) {
  ServiceOptions options;
  options.max_deadline = std::chrono::milliseconds(300);
  start(options);
  const auto begin = std::chrono::steady_clock::now();
  const auto late = begin + std::chrono::seconds(5);
  grpc::ClientContext contexts[3];
  const auto deform = stub->Deform(&contexts[0], {});                  // an engine that never ends
  const auto uploading = stub->RegisterGeometry(&contexts[1], &info);  // a client that never sends anything
  const auto stream = stub->DeformStream(&contexts[2]);
  const auto job = engine.job(0);
  ASSERT_TRUE(job->call().deadline);
  EXPECT_LT(*job->call().deadline, late);
  EXPECT_FALSE(deform->Finish().ok());
  EXPECT_TRUE(support::eventually([&] { return job->cancelled(); })) << "the client may hear of it first";
  EXPECT_FALSE(uploading->Finish().ok());
  EXPECT_LT(std::chrono::steady_clock::now(), late);
  // A stream is as long as its client wants; its requests are not.
  v1::DeformStreamRequest request;
  request.mutable_request();
  EXPECT_TRUE(stream->Write(request));
  const auto second = engine.job(1);
  ASSERT_TRUE(second->call().deadline);
  EXPECT_GT(*second->call().deadline, std::chrono::steady_clock::now() - std::chrono::milliseconds(300));
  second->push_block(1);
  second->end();
  stream->WritesDone();
  v1::DeformReply reply;
  EXPECT_TRUE(stream->Read(&reply));
  EXPECT_TRUE(stream->Finish().ok());
}

TEST_P(ServiceUnary, CallsThatTheServerEndsSayByWhichOption) {
  engine.on_estimate = [](const v1::EstimateRequest&, const CallContext& call, const auto& done) {
    std::this_thread::sleep_until(*call.deadline);
    done({{}, Error(ErrorCode::deadline_exceeded, "deadline exceeded"), {}});
  };
  ServiceOptions options;
  options.max_deadline = std::chrono::milliseconds(1500);
  start(options);
  const auto ask = [&](std::chrono::milliseconds own) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + own);
    v1::EstimateReply reply;
    return stub->Estimate(&context, {}, &reply);
  };
  const grpc::Status status = ask(std::chrono::seconds(60));
  EXPECT_THAT(status, EndedWith(StatusCode::DEADLINE_EXCEEDED));
  EXPECT_NE(status.error_message().find("1.5 s that this server allows (--max-deadline)"), std::string::npos)
      << status.error_message();
  const grpc::Status own = ask(std::chrono::milliseconds(50));
  EXPECT_THAT(own, EndedWith(StatusCode::DEADLINE_EXCEEDED));
  EXPECT_EQ(own.error_message().find("--max-deadline"), std::string::npos) << own.error_message();
}

// With one thread for calls: estimates that wait hold none, end when their clients leave, and are answered when it is their turn.
TEST_P(ServiceUnary, EstimatesThatWaitHoldNoThread) {
  ServiceOptions options;
  options.call_threads = 1;
  using Done = std::function<void(Engine::Outcome<v1::EstimateReply>)>;
  std::mutex mutex;
  std::vector<std::pair<CallContext, Done>> waiting;
  engine.on_estimate = [&](const v1::EstimateRequest&, const CallContext& call, Done done) {
    const std::lock_guard lock(mutex);
    waiting.emplace_back(call, std::move(done));
  };
  start(options);
  grpc::ClientContext contexts[3];
  std::vector<std::future<grpc::Status>> estimates;
  v1::EstimateReply replies[3];
  for (int i = 0; i < 3; ++i) {
    estimates.push_back(std::async(std::launch::async, [&, i] {
      v1::EstimateRequest request;
      request.mutable_setup()->set_geometry(std::to_string(i));
      return stub->Estimate(&contexts[i], request, &replies[i]);
    }));
    EXPECT_TRUE(support::eventually([&] {
      const std::lock_guard lock(mutex);
      return waiting.size() == static_cast<std::size_t>(i) + 1;
    }));
  }
  EXPECT_TRUE(get_geometry("0123").ok()) << "the thread is free";
  contexts[0].TryCancel();
  EXPECT_TRUE(support::eventually([&] { return waiting[0].first.stop.stop_requested(); }));
  waiting[0].second({std::nullopt, Error(ErrorCode::cancelled, "cancelled by the caller"), {}});
  EXPECT_THAT(estimates[0].get(), EndedWith(StatusCode::CANCELLED));
  v1::EstimateReply reply;
  reply.set_system_id("a system");
  waiting[1].second({reply, std::nullopt, {}});
  EXPECT_THAT(estimates[1].get(), EndedWith(StatusCode::OK));
  EXPECT_EQ(replies[1].system_id(), "a system");
  waiting[2].second({std::nullopt, Error(ErrorCode::out_of_budget, "too much", 300), {}});
  EXPECT_THAT(estimates[2].get(), EndedWith(StatusCode::RESOURCE_EXHAUSTED));
  const auto& trailing = contexts[2].GetServerTrailingMetadata();
  EXPECT_EQ(trailing.count("retry-after-ms"), 1u);
}

TEST_P(ServiceUnary, EveryMethodReachesTheEngineAndBack) {
  start();
  EXPECT_TRUE(get_geometry("0123").ok());
  EXPECT_EQ(info.id(), "0123");
  {
    grpc::ClientContext context;
    v1::ListGeometriesRequest request;
    v1::ListGeometriesReply reply;
    request.set_page_token("x");
    EXPECT_TRUE(stub->ListGeometries(&context, request, &reply).ok());
    EXPECT_EQ(reply.next_page_token(), "x+");
  }
  {
    grpc::ClientContext context;
    v1::DeleteGeometryRequest request;
    v1::DeleteGeometryReply reply;
    request.set_with_setups(true);
    EXPECT_TRUE(stub->DeleteGeometry(&context, request, &reply).ok());
    EXPECT_EQ(reply.setups_deleted(), 2u);
  }
  {
    grpc::ClientContext context;
    v1::EstimateRequest request;
    v1::EstimateReply reply;
    request.mutable_setup()->set_geometry("g");
    EXPECT_TRUE(stub->Estimate(&context, request, &reply).ok());
    EXPECT_EQ(reply.system_id(), "of g");
  }
  {
    grpc::ClientContext context;
    v1::GetSystemRequest request;
    v1::SystemInfo reply;
    request.set_id("s");
    EXPECT_TRUE(stub->GetSystem(&context, request, &reply).ok());
    EXPECT_EQ(reply.id(), "s");
  }
  {
    grpc::ClientContext context;
    v1::ListSystemsRequest request;
    v1::ListSystemsReply reply;
    request.set_geometry_id("of this");
    EXPECT_TRUE(stub->ListSystems(&context, request, &reply).ok());
    EXPECT_EQ(reply.next_page_token(), "of this");
  }
  {
    grpc::ClientContext context;
    v1::ReleaseSystemRequest request;
    v1::ReleaseSystemReply reply;
    request.set_forget(true);
    EXPECT_TRUE(stub->ReleaseSystem(&context, request, &reply).ok());
    EXPECT_EQ(reply.bytes_released(), 7u);
  }
}

TEST_P(ServiceUnary, ServerInfoTellsTheStreamLimit) {
  ServiceOptions options;
  options.stream.open_requests = 77;
  start(options);
  grpc::ClientContext context;
  v1::ServerInfo reply;
  EXPECT_TRUE(stub->GetServerInfo(&context, {}, &reply).ok());
  EXPECT_EQ(reply.version(), "fake");
  EXPECT_EQ(reply.limits().max_streams_per_call(), 77u);
}

TEST_P(ServiceUnary, ErrorsOfTheEngineArriveWithCodeMessageAndRetryHint) {
  engine.before = [](const CallContext*) { throw Error(ErrorCode::out_of_budget, "handle \"roof\": too much\n", 1500); };
  start();
  const grpc::Status status = get_geometry("x");
  EXPECT_THAT(status, EndedWith(StatusCode::RESOURCE_EXHAUSTED));
  EXPECT_EQ(status.error_message(), "handle \"roof\": too much\\x0a");
  EXPECT_EQ(hint, "1500");
}

TEST_P(ServiceUnary, AnythingElseThrownIsInternalAndTheServerLives) {
  int calls = 0;
  engine.before = [&](const CallContext*) {
    if (++calls == 1) throw std::runtime_error("surprise");
    if (calls == 2) throw 42;
    if (calls == 3) throw std::bad_alloc();
  };
  start();
  EXPECT_THAT(get_geometry("x"), EndedWith(StatusCode::INTERNAL));
  EXPECT_THAT(get_geometry("x"), EndedWith(StatusCode::INTERNAL));
  EXPECT_THAT(get_geometry("x"), EndedWith(StatusCode::RESOURCE_EXHAUSTED));
  EXPECT_TRUE(get_geometry("x").ok());
}

TEST_P(ServiceUnary, TextWithNulBytesArrivesWhole) {
  start();
  const std::string odd("a\0b\n\x7f", 5);
  EXPECT_TRUE(get_geometry(odd).ok());
  EXPECT_EQ(info.id(), odd);
}

/// Sends bytes as they are to a method with one request and one reply.
grpc::Status send_bytes(const std::shared_ptr<grpc::Channel>& channel, const std::string& method, const std::string& bytes) {
  grpc::GenericStub generic(channel);
  const grpc::Slice slice(bytes);
  const grpc::ByteBuffer request(&slice, 1);
  grpc::ByteBuffer reply;
  grpc::ClientContext context;
  std::mutex mutex;
  std::condition_variable changed;
  std::optional<grpc::Status> result;
  generic.UnaryCall(&context, "/deform.v1.DeformService/" + method, {}, &request, &reply, [&](grpc::Status status) {
    const std::lock_guard lock(mutex);
    result = std::move(status);
    changed.notify_one();
  });
  std::unique_lock lock(mutex);
  changed.wait(lock, [&] { return result.has_value(); });
  return *result;
}

TEST_P(ServiceUnary, BytesThatAreNoMessageAreInvalidArguments) {
  start();
  const std::string truncated =
      "\x0a\x7f"
      "abc";  // announces 127 bytes, has 3
  const std::string not_utf8 =
      "\x0a\x03"
      "\xff\xfe"
      "a";  // id of three bytes that are no text
  // A length-delimited field around `content`.
  const auto wrapped = [](char tag, const std::string& content) {
    std::string out(1, tag);
    std::size_t length = content.size();
    for (; length >= 0x80; length >>= 7) out.push_back(static_cast<char>(length | 0x80));
    out.push_back(static_cast<char>(length));
    return out.append(content);
  };
  std::string deep;  // the complement of the complement of ...
  for (int i = 0; i < 200; ++i) deep = wrapped('\x62', deep);
  const std::string deep_setup = wrapped('\x0a', wrapped('\x22', deep));
  struct Case {
    const char* name;
    const char* method;
    std::string bytes;
  };
  const Case cases[] = {{"truncated", "GetGeometry", truncated},
                        {"not UTF-8", "GetGeometry", not_utf8},
                        {"wrong wire type", "ListGeometries", "\x0a\x01x"},
                        {"group that never ends", "GetSystem", "\x0b"},
                        {"nested too deeply", "Estimate", deep_setup}};
  for (const Case& c : cases) {
    const grpc::Status status = send_bytes(channel, c.method, c.bytes);
    if (std::string(c.name) == "wrong wire type") {
      EXPECT_TRUE(status.ok()) << "an unknown field by the rules of protobuf";
      continue;
    }
    EXPECT_THAT(status, EndedWith(StatusCode::INVALID_ARGUMENT)) << c.name << ": " << status.error_message();
  }
  EXPECT_TRUE(get_geometry("still there").ok());
}

TEST_P(ServiceUnary, MessagesBeyondTheLimitAreRefused) {
  start();
  EXPECT_THAT(get_geometry(std::string(5 << 20, 'x')), EndedWith(StatusCode::RESOURCE_EXHAUSTED));
  EXPECT_TRUE(get_geometry("x").ok());
}

TEST_P(ServiceUnary, ACallThatCameTooLateIsNotComputed) {
  std::atomic<int> computed{0};
  std::atomic<bool> release{false};
  engine.before = [&](const CallContext*) {
    ++computed;
    support::eventually([&] { return release.load(); });
  };
  ServiceOptions options;
  options.call_threads = 1;
  start(options);
  std::thread blocker([&] {
    v1::GeometryInfo reply;
    grpc::ClientContext context;
    EXPECT_TRUE(stub->GetGeometry(&context, {}, &reply).ok());
  });
  EXPECT_TRUE(support::eventually([&] { return computed == 1; }));
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::milliseconds(30));
  v1::GeometryInfo reply;
  EXPECT_THAT(stub->GetGeometry(&context, {}, &reply), EndedWith(StatusCode::DEADLINE_EXCEEDED));
  // The server counts the time from when it received the call, which may be after the client gave up.
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  release = true;
  blocker.join();
  server->running().stop(std::chrono::seconds(1));
  EXPECT_EQ(computed, 1);
}

TEST(LiveCallsLimit, LeavesRoomForTheNextClient) {
  LiveCalls live(100);
  const auto let_in = [&](const std::string& client) {
    live.enter(client);
    try {
      live.check(client);
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::out_of_budget);
      EXPECT_EQ(error.refusal(), Refusal::queue);
      EXPECT_GT(error.retry_after_ms(), 0u);
      live.leave(client);
      return false;
    }
    return true;
  };
  int of_a = 0, of_b = 0;
  while (of_a < 1000 && let_in("a")) ++of_a;
  while (of_b < 1000 && let_in("b")) ++of_b;
  EXPECT_EQ(of_a, 80);
  EXPECT_EQ(of_b, 16);
  EXPECT_FALSE(let_in("a"));
  EXPECT_TRUE(let_in("c"));
  for (; of_b > 0; --of_b) live.leave("b");
  EXPECT_TRUE(let_in("d"));
  LiveCalls any(0);
  for (int i = 0; i < 10'000; ++i) any.enter("a");
  EXPECT_NO_THROW(any.check("a"));
}

TEST_P(ServiceUnary, StreamsThatRestAreCountedAndRefusedBeyondTheLimit) {
  ServiceOptions options;
  options.max_calls = 10;
  start(options);
  std::vector<std::unique_ptr<grpc::ClientContext>> contexts;
  std::vector<std::unique_ptr<grpc::ClientReaderWriter<v1::DeformStreamRequest, v1::DeformReply>>> streams;
  for (int i = 0; i < 8; ++i) {
    contexts.push_back(std::make_unique<grpc::ClientContext>());
    streams.push_back(stub->DeformStream(contexts.back().get()));
  }
  const auto ask = [&](std::string& hint) {
    grpc::ClientContext context;
    v1::GeometryInfo reply;
    const grpc::Status status = stub->GetGeometry(&context, {}, &reply);
    hint = retry_hint(context);
    return status;
  };
  std::string hint;
  grpc::Status status;
  EXPECT_TRUE(support::eventually([&] {
    status = ask(hint);
    return !status.ok();
  }));
  EXPECT_THAT(status, EndedWith(StatusCode::RESOURCE_EXHAUSTED));
  EXPECT_NE(status.error_message().find("--max-calls"), std::string::npos) << status.error_message();
  EXPECT_FALSE(hint.empty());
  streams.front()->WritesDone();
  EXPECT_THAT(streams.front()->Finish(), EndedWith(StatusCode::OK));
  EXPECT_TRUE(support::eventually([&] { return ask(hint).ok(); }));
  for (const auto& context : contexts) context->TryCancel();
}

// A proxy that adds its header leaves those that the client sent before it.
TEST_P(ServiceUnary, ATrustedProxySaysWhoCallsAndClientsDoNot) {
  if (GetParam() != support::Transport::loopback) return;  // without an address nobody is a proxy
  std::mutex mutex;
  std::vector<std::string> clients;
  engine.on_estimate = [&](const v1::EstimateRequest&, const CallContext& call, const auto& done) {
    {
      const std::lock_guard lock(mutex);
      clients.push_back(call.client);
    }
    done({v1::EstimateReply(), std::nullopt, {}});
  };
  ServiceOptions options;
  options.proxies = TrustedProxies("127.0.0.0/8");
  start(options);
  const auto ask = [&](const std::vector<std::string>& forwarded_for) {
    grpc::ClientContext context;
    for (const std::string& one : forwarded_for) context.AddMetadata("x-forwarded-for", one);
    v1::EstimateReply reply;
    EXPECT_THAT(stub->Estimate(&context, {}, &reply), EndedWith(StatusCode::OK));
  };
  ask({"10.0.0.9"});
  ask({"10.0.0.8", "10.0.0.9"});
  ask({"10.0.0.8, 10.0.0.9"});
  ask({});
  EXPECT_EQ(clients, (std::vector<std::string>{"ipv4:10.0.0.9", "ipv4:10.0.0.9", "ipv4:10.0.0.9", "ipv4:127.0.0.1"}));
}

// Meshes are written by threads of their own: as many uploads as there are threads may wait for a disk that hangs.
TEST_P(ServiceUnary, QuestionsDoNotWaitForUploads) {
  std::atomic<bool> release{false};
  std::atomic<int> uploads{0};
  engine.before = [&](const CallContext* call) {
    if (call != nullptr && uploads++ == 0) support::eventually([&] { return release.load(); });
  };
  ServiceOptions options;
  options.call_threads = 1;
  start(options);
  std::thread blocker([&] {
    grpc::ClientContext context;
    v1::GeometryInfo reply;
    const auto writer = stub->RegisterGeometry(&context, &reply);
    v1::RegisterGeometryRequest message;
    message.mutable_header()->set_point_count(1);
    writer->Write(message);
    message.mutable_points()->set_xyz(std::string(sizeof(Vec3), '\0'));
    writer->Write(message);
    writer->WritesDone();
    EXPECT_TRUE(writer->Finish().ok());
  });
  EXPECT_TRUE(support::eventually([&] { return uploads == 1; }));
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(30));
  v1::GeometryInfo reply;
  EXPECT_TRUE(stub->GetGeometry(&context, {}, &reply).ok());
  EXPECT_FALSE(release);
  release = true;
  blocker.join();
}

TEST_P(ServiceUnary, MoreWaitingCallsThanAllowedAreRefusedWithAHint) {
  std::atomic<bool> release{false};
  std::atomic<int> computing{0};
  engine.before = [&](const CallContext*) {
    ++computing;
    support::eventually([&] { return release.load(); });
  };
  ServiceOptions options;
  options.call_threads = 1;
  options.waiting_calls = 1;
  start(options);
  std::vector<std::thread> threads;
  const auto call = [&] {
    v1::GeometryInfo reply;
    grpc::ClientContext context;
    EXPECT_TRUE(stub->GetGeometry(&context, {}, &reply).ok());
  };
  threads.emplace_back(call);
  EXPECT_TRUE(support::eventually([&] { return computing == 1; }));
  // One more may wait; of ten others nearly all are refused, none hangs.
  std::atomic<int> refused{0};
  for (int i = 0; i < 10; ++i) {
    threads.emplace_back([&] {
      v1::GeometryInfo reply;
      grpc::ClientContext context;
      const grpc::Status status = stub->GetGeometry(&context, {}, &reply);
      if (status.ok()) return;
      EXPECT_THAT(status, EndedWith(StatusCode::RESOURCE_EXHAUSTED));
      EXPECT_FALSE(retry_hint(context).empty());
      ++refused;
    });
  }
  EXPECT_TRUE(support::eventually([&] { return refused == 9; }));
  release = true;
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(refused, 9);
}

/// Calls a method of another service by bytes: the stubs of gRPC's own services are not installed everywhere.
TEST_P(ServiceUnary, HealthAnswersServing) {
  start();
  grpc::GenericStub generic(channel);
  for (const std::string& name : {std::string(), std::string("deform.v1.DeformService")}) {
    std::string bytes;
    if (!name.empty()) bytes.append("\x0a").append(1, static_cast<char>(name.size())).append(name);
    const grpc::Slice slice(bytes);
    const grpc::ByteBuffer request(&slice, 1);
    grpc::ByteBuffer reply;
    grpc::ClientContext context;
    grpc::CompletionQueue queue;
    auto call = generic.PrepareUnaryCall(&context, "/grpc.health.v1.Health/Check", request, &queue);
    call->StartCall();
    grpc::Status status;
    call->Finish(&reply, &status, nullptr);
    void* tag = nullptr;
    bool ok = false;
    queue.Next(&tag, &ok);
    ASSERT_TRUE(status.ok()) << status.error_message();
    grpc::Slice answer;
    ASSERT_TRUE(reply.DumpToSingleSlice(&answer).ok());
    EXPECT_EQ(std::string(answer.begin(), answer.end()), "\x08\x01") << "status: SERVING";
  }
}

TEST_P(ServiceUnary, ReflectionListsTheService) {
  start();
  grpc::GenericStub generic(channel);
  grpc::ClientContext context;
  grpc::CompletionQueue queue;
  auto call = generic.PrepareCall(&context, "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo", &queue);
  const auto step = [&] {
    void* tag = nullptr;
    bool ok = false;
    queue.Next(&tag, &ok);
    return ok;
  };
  call->StartCall(nullptr);
  ASSERT_TRUE(step());
  const grpc::Slice slice("\x3a\x01*");  // list_services: "*"
  call->Write(grpc::ByteBuffer(&slice, 1), nullptr);
  ASSERT_TRUE(step());
  grpc::ByteBuffer reply;
  call->Read(&reply, nullptr);
  ASSERT_TRUE(step());
  grpc::Slice answer;
  ASSERT_TRUE(reply.DumpToSingleSlice(&answer).ok());
  const std::string text(answer.begin(), answer.end());
  EXPECT_NE(text.find("deform.v1.DeformService"), std::string::npos);
  EXPECT_NE(text.find("grpc.health.v1.Health"), std::string::npos);
  call->WritesDone(nullptr);
  ASSERT_TRUE(step());
  grpc::Status status;
  call->Finish(&status, nullptr);
  step();
  EXPECT_TRUE(status.ok());
}

DEFORM_BOTH_TRANSPORTS(ServiceUnary);

}  // namespace
}  // namespace deform::server::service_unary_test
