// SPDX-License-Identifier: GPL-3.0-or-later
// The service for the operator, over the wire: calls of every kind are listed and cancelled, the server is drained, limits
// change.
#include <atomic>
#include <fstream>
#include <map>
#include <thread>
#include <vector>

#include "core/codec/geometry_id.h"
#include "deform/v1/admin.grpc.pb.h"
#include "server/rpc/connection_calls.h"
#include "tests/server/ended_with.h"
#include "tests/server/service_fixture.h"

namespace deform::server::admin_test {
namespace {

using grpc::StatusCode;
using support::eventually;

class AdminCalls : public ServiceFixture {
 protected:
  void begin(const ServiceOptions& options = {}) {
    start(options);
    admin = v1::Admin::NewStub(channel);
  }
  template <typename Request, typename Reply>
  grpc::Status ask(grpc::Status (v1::Admin::StubInterface::*method)(grpc::ClientContext*, const Request&, Reply*),
                   const Request& request, Reply& reply, const std::string& token = "") {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(20));
    if (!token.empty()) context.AddMetadata("authorization", "Bearer " + token + "-token");
    v1::Admin::StubInterface& stub_ = *admin;
    return (stub_.*method)(&context, request, &reply);
  }
  using Stub = v1::Admin::StubInterface;
  v1::ListCallsReply list(const std::string& token = "") {
    v1::ListCallsReply reply;
    EXPECT_THAT(ask(&Stub::ListCalls, v1::ListCallsRequest(), reply, token), EndedWith(StatusCode::OK));
    return reply;
  }
  /// The call of this method; waits until it is there, and in this state.
  v1::CallInfo found(const std::string& method, v1::CallState state = v1::CALL_OPEN, bool request = false) {
    v1::CallInfo info;
    EXPECT_TRUE(eventually([&] {
      const auto reply = list();
      for (const auto& call : reply.calls()) {
        if (call.method() == method && call.state() == state && (call.stream() != 0) == request) {
          info = call;
          return true;
        }
      }
      return false;
    })) << method;
    return info;
  }
  grpc::Status cancel(std::uint64_t id, const std::string& token = "", const std::string& reason = "too large") {
    v1::CancelCallRequest request;
    request.set_id(id);
    request.set_reason(reason);
    v1::CancelCallReply reply;
    return ask(&Stub::CancelCall, request, reply, token);
  }
  grpc::Status drain() {
    v1::DrainReply reply;
    return ask(&Stub::Drain, v1::DrainRequest(), reply);
  }
  grpc::Status undrain() {
    v1::UndrainReply reply;
    return ask(&Stub::Undrain, v1::UndrainRequest(), reply);
  }
  static void expect_told(const grpc::Status& status) {
    EXPECT_THAT(status, EndedWith(StatusCode::CANCELLED));
    EXPECT_EQ(status.error_message(), "the operator of the server cancelled this call: too large");
  }
  static std::string line(const std::string& name, const std::string& role, const std::string& more = "") {
    codec::Sha256 digest;
    const std::string token = name + "-token";
    digest.add(token.data(), token.size());
    return name + " " + role + " sha256:" + digest.hex() + " " + more + "\n";
  }

  std::unique_ptr<v1::Admin::Stub> admin;
};

TEST_P(AdminCalls, APreparationIsListedAndCancelled) {
  engine.on_prepare = [](const v1::PrepareRequest&, const CallContext& call, auto, auto) {
    call.open->enter(v1::CALL_PREPARING);
  };
  begin();
  grpc::ClientContext context;
  context.AddMetadata("x-request-id", "nightly-17");
  v1::PrepareRequest request;
  request.mutable_setup()->set_geometry("0123");
  const auto reader = stub->Prepare(&context, request);
  const v1::CallInfo call = found("Prepare", v1::CALL_PREPARING);
  EXPECT_EQ(call.geometry(), "0123");
  EXPECT_EQ(call.tenant(), "default");
  EXPECT_EQ(call.request(), "nightly-17");
  EXPECT_NE(call.peer(), "");
  EXPECT_GT(call.bytes_held(), 0u);
  EXPECT_THAT(cancel(call.id()), EndedWith(StatusCode::OK));
  v1::PrepareReply reply;
  while (reader->Read(&reply)) {
  }
  expect_told(reader->Finish());
  EXPECT_TRUE(eventually([&] { return list().calls_size() == 0; }));
  EXPECT_THAT(cancel(call.id()), EndedWith(StatusCode::NOT_FOUND));
}

TEST_P(AdminCalls, WhoHasTheAnswerOfACallDoesNotFindItListed) {
  begin();
  for (int i = 0; i < 500; ++i) ASSERT_EQ(list().calls_size(), 0) << "after " << i << " lists";
}

TEST_P(AdminCalls, GrpcSaysHowManyCallsAConnectionHas) {
  if (GetParam() == support::Transport::in_process) return;  // no connection
  begin();
  constexpr std::size_t uploads = 5;
  std::vector<grpc::ClientContext> contexts(uploads);
  std::vector<v1::GeometryInfo> infos(uploads);
  std::vector<std::unique_ptr<grpc::ClientWriter<v1::RegisterGeometryRequest>>> writers;
  for (std::size_t i = 0; i < uploads; ++i) writers.push_back(stub->RegisterGeometry(&contexts[i], &infos[i]));
  const std::string peer = found("RegisterGeometry").peer();
  ConnectionCalls connection_calls;
  const auto calls = [&] {
    const auto live = connection_calls.of({peer, "ipv4:127.0.0.1:1"});
    return live.size() == 1 ? live.at(peer) : live.size();
  };
  EXPECT_TRUE(eventually([&] { return calls() == uploads; })) << calls();
  for (std::size_t i = 1; i < uploads; ++i) contexts[i].TryCancel();
  EXPECT_TRUE(eventually([&] { return calls() == 1; })) << calls() << " after the others were reset";
  contexts[0].TryCancel();
  for (const auto& writer : writers) EXPECT_THAT(writer->Finish(), EndedWith(StatusCode::CANCELLED));
}

TEST_P(AdminCalls, AnUploadThatStandsStillIsCancelled) {
  begin();
  grpc::ClientContext context;
  v1::GeometryInfo info;
  const auto writer = stub->RegisterGeometry(&context, &info);
  v1::RegisterGeometryRequest header;
  header.mutable_header()->set_id("abcd");
  header.mutable_header()->set_point_count(1000);
  ASSERT_TRUE(writer->Write(header));
  const auto upload = engine.upload(0);
  EXPECT_THAT(cancel(found("RegisterGeometry").id()), EndedWith(StatusCode::OK));
  expect_told(writer->Finish());
  EXPECT_TRUE(eventually([&] { return upload->destroyed.load(); }));
}

TEST_P(AdminCalls, AReaderThatNeverReadsIsCutOff) {
  engine.point_count = 3'000'000;  // more than the connection takes by itself
  begin();
  grpc::ClientContext context;
  v1::GetPointsRequest request;
  request.set_id("abc");
  const auto reader = stub->GetPoints(&context, request);
  EXPECT_THAT(cancel(found("GetPoints").id()), EndedWith(StatusCode::OK));
  EXPECT_TRUE(eventually([&] { return list().calls_size() == 0; })) << "though nobody has read";
  v1::PointChunk chunk;
  while (reader->Read(&chunk)) {
  }
  EXPECT_THAT(reader->Finish(), EndedWith(StatusCode::CANCELLED));
}

TEST_P(AdminCalls, WhatTheWorkSaysOfItsStopIsNotWhatTheClientHears) {
  engine.before = [](const CallContext* call) {
    while (!call->stop.stop_requested()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    throw Error(ErrorCode::cancelled, "cancelled");
  };
  begin();
  grpc::Status status;
  std::thread caller([&] {
    grpc::ClientContext context;
    v1::EstimateReply reply;
    status = stub->Estimate(&context, {}, &reply);
  });
  EXPECT_THAT(cancel(found("Estimate").id()), EndedWith(StatusCode::OK));
  caller.join();
  expect_told(status);
}

TEST_P(AdminCalls, OneRequestOfAStreamIsCancelledOrTheWholeStream) {
  begin();
  grpc::ClientContext context;
  const auto stream = stub->DeformStream(&context);
  v1::DeformStreamRequest request;
  request.mutable_request()->set_system_id("5678");
  for (std::uint64_t id : {1, 2}) {
    request.set_request_id(id);
    ASSERT_TRUE(stream->Write(request));
    engine.job(id - 1);
  }
  const v1::CallInfo whole = found("DeformStream"), one = found("DeformStream", v1::CALL_OPEN, true);
  EXPECT_EQ(one.stream(), whole.id());
  EXPECT_EQ(one.stream_request(), 1u);
  EXPECT_EQ(one.system(), "5678");
  EXPECT_TRUE(eventually([&] { return list().calls_size() == 3; })) << "the stream and its requests";
  EXPECT_THAT(cancel(one.id()), EndedWith(StatusCode::OK));
  // The engine is what ends a request (open_calls_test.cpp): this one only sees that it is asked to.
  EXPECT_TRUE(engine.job(0)->call().stop.stop_requested());
  EXPECT_STREQ(engine.job(0)->call().open->ended()->what(), "the operator of the server cancelled this call: too large");
  EXPECT_FALSE(engine.job(1)->call().stop.stop_requested());
  engine.job(0)->end(*engine.job(0)->call().open->ended());
  v1::DeformReply reply;
  ASSERT_TRUE(stream->Read(&reply));
  EXPECT_EQ(reply.error().message(), "the operator of the server cancelled this call: too large");
  engine.job(1)->push_block(1);
  ASSERT_TRUE(stream->Read(&reply)) << "the other one goes on";
  EXPECT_THAT(cancel(whole.id()), EndedWith(StatusCode::OK));
  while (stream->Read(&reply)) {
  }
  expect_told(stream->Finish());
  EXPECT_TRUE(engine.job(1)->cancelled());
}

TEST_P(AdminCalls, TheyAreAnsweredWhileEveryOtherThreadIsBusy) {
  std::atomic<bool> go_on{false};
  std::atomic<int> at_work{0};
  engine.before = [&](const CallContext*) {
    ++at_work;
    while (!go_on) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  };
  ServiceOptions options;
  options.call_threads = 2;
  begin(options);
  std::vector<std::thread> callers;
  std::atomic<int> cancelled{0};
  for (int i = 0; i < 6; ++i) {
    callers.emplace_back([&] {
      grpc::ClientContext context;
      v1::GeometryInfo info;
      if (stub->GetGeometry(&context, {}, &info).error_code() == StatusCode::CANCELLED) ++cancelled;
    });
  }
  EXPECT_TRUE(eventually([&] { return at_work == 2 && list().calls_size() == 6; }));
  const auto listed = list();
  for (const auto& call : listed.calls()) {
    if (call.method() == "GetGeometry") {
      EXPECT_THAT(cancel(call.id()), EndedWith(StatusCode::OK));
    }
  }
  go_on = true;
  for (auto& caller : callers) caller.join();
  EXPECT_EQ(cancelled, 4) << "those that waited for a thread, and then did not run";
}

TEST_P(AdminCalls, DrainRefusesNewWorkAndFinishesTheOld) {
  begin();
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(30));
  const auto stream = stub->DeformStream(&context);
  v1::DeformStreamRequest request;
  request.set_request_id(1);
  request.mutable_request();
  ASSERT_TRUE(stream->Write(request));
  engine.job(0);
  EXPECT_THAT(drain(), EndedWith(StatusCode::OK));
  grpc::ClientContext refused;
  v1::EstimateReply estimate;
  const grpc::Status status = stub->Estimate(&refused, {}, &estimate);
  EXPECT_THAT(status, EndedWith(StatusCode::UNAVAILABLE));
  EXPECT_NE(status.error_message().find("drained"), std::string::npos);
  EXPECT_EQ(retry_hint(refused), "2000");
  v1::ServerInfo info;
  grpc::ClientContext reading;
  EXPECT_THAT(stub->GetServerInfo(&reading, {}, &info), EndedWith(StatusCode::OK)) << "what only looks is let in";
  EXPECT_TRUE(info.draining());
  v1::DeformReply reply;
  request.set_request_id(2);
  ASSERT_TRUE(stream->Write(request));
  ASSERT_TRUE(stream->Read(&reply));
  EXPECT_EQ(reply.request_id(), 2u) << "a stream takes nothing new either";
  EXPECT_EQ(reply.error().code(), static_cast<std::uint32_t>(StatusCode::UNAVAILABLE));
  engine.job(0)->push_block(1);
  engine.job(0)->end();
  ASSERT_TRUE(stream->Read(&reply)) << "what it has begun is finished";
  EXPECT_FALSE(stream->Read(&reply));
  EXPECT_THAT(stream->Finish(), EndedWith(StatusCode::UNAVAILABLE));
  EXPECT_THAT(undrain(), EndedWith(StatusCode::OK));
  grpc::ClientContext again;
  EXPECT_THAT(stub->Estimate(&again, {}, &estimate), EndedWith(StatusCode::OK));
  grpc::ClientContext fresh;
  const auto other = stub->DeformStream(&fresh);
  ASSERT_TRUE(other->Write(request));
  engine.job(1)->end();
  other->WritesDone();
  while (other->Read(&reply)) {
  }
  EXPECT_THAT(other->Finish(), EndedWith(StatusCode::OK));
}

TEST_P(AdminCalls, AnOperatorOfATenantHasItsOwnCallsAlone) {
  engine.on_prepare = [](const auto&, const auto&, auto, auto) {};
  support::TemporaryFolder folder;
  ServiceOptions options;
  options.access.identities = folder.path() / "identities";
  std::ofstream(options.access.identities) << line("a", "user", "tenant=acme") << line("b", "user", "tenant=b")
                                           << line("ops", "operator") << line("acme-ops", "operator", "tenant=acme")
                                           << line("owner", "owner");
  begin(options);
  grpc::ClientContext of_a, of_b;
  of_a.AddMetadata("authorization", "Bearer a-token");
  of_b.AddMetadata("authorization", "Bearer b-token");
  for (grpc::ClientContext* context : {&of_a, &of_b}) {
    context->set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(60));
  }
  const auto by_a = stub->Prepare(&of_a, {}), by_b = stub->Prepare(&of_b, {});
  ASSERT_TRUE(eventually([&] { return list("ops").calls_size() == 2; }));
  const auto everybodys = list("ops");
  const auto acmes = list("acme-ops");
  ASSERT_EQ(acmes.calls_size(), 1);
  EXPECT_EQ(acmes.calls(0).identity(), "a");
  EXPECT_EQ(acmes.calls(0).tenant(), "acme");
  const auto& other = everybodys.calls(everybodys.calls(0).identity() == "b" ? 0 : 1);
  EXPECT_THAT(cancel(other.id(), "acme-ops"), EndedWith(StatusCode::NOT_FOUND));
  EXPECT_THAT(cancel(other.id(), "owner"), EndedWith(StatusCode::PERMISSION_DENIED));
  v1::DrainReply drained;
  EXPECT_THAT(ask(&Stub::Drain, v1::DrainRequest(), drained, "acme-ops"), EndedWith(StatusCode::PERMISSION_DENIED));
  v1::SetLimitReply set;
  EXPECT_THAT(ask(&Stub::SetLimit, v1::SetLimitRequest(), set, "acme-ops"), EndedWith(StatusCode::PERMISSION_DENIED));
  v1::StoreReply store;
  EXPECT_THAT(ask(&Stub::BackupStore, v1::BackupStoreRequest(), store, "acme-ops"), EndedWith(StatusCode::PERMISSION_DENIED));
  EXPECT_THAT(ask(&Stub::CheckStore, v1::CheckStoreRequest(), store, "acme-ops"), EndedWith(StatusCode::PERMISSION_DENIED));
  v1::ListConnectionsReply connections;
  EXPECT_THAT(ask(&Stub::ListConnections, v1::ListConnectionsRequest(), connections, "acme-ops"),
              EndedWith(StatusCode::PERMISSION_DENIED));
  v1::ListLimitsReply limits;
  EXPECT_THAT(ask(&Stub::ListLimits, v1::ListLimitsRequest(), limits, "acme-ops"), EndedWith(StatusCode::PERMISSION_DENIED));
  v1::UndrainReply undrained;
  EXPECT_THAT(ask(&Stub::Undrain, v1::UndrainRequest(), undrained, "acme-ops"), EndedWith(StatusCode::PERMISSION_DENIED));
  EXPECT_THAT(cancel(acmes.calls(0).id(), "acme-ops"), EndedWith(StatusCode::OK));
  EXPECT_THAT(cancel(other.id(), "ops"), EndedWith(StatusCode::OK));
  v1::PrepareReply reply;
  for (const auto& reader : {by_a.get(), by_b.get()}) {
    while (reader->Read(&reply)) {
    }
    expect_told(reader->Finish());
  }
}

TEST_P(AdminCalls, RefuseWhatIsWrong) {
  begin();
  EXPECT_THAT(cancel(123456), EndedWith(StatusCode::NOT_FOUND));
  EXPECT_THAT(cancel(1, "", std::string(201, 'x')), EndedWith(StatusCode::INVALID_ARGUMENT));
  v1::EvictReply evicted;
  v1::EvictRequest evict;
  EXPECT_THAT(ask(&Stub::Evict, evict, evicted), EndedWith(StatusCode::INVALID_ARGUMENT));
  evict.set_system_id("0123456789");
  evict.set_all(true);
  EXPECT_THAT(ask(&Stub::Evict, evict, evicted), EndedWith(StatusCode::INVALID_ARGUMENT));
}

DEFORM_BOTH_TRANSPORTS(AdminCalls);

TEST(AdminLimits, AreShownAndChanged) {
  ServerOptions options;
  options.limits = {{"max-points", "50000000"}, {"queue-limit", "another one's"}};
  support::InProcessServer server(support::Transport::loopback, options);
  const auto admin = v1::Admin::NewStub(server.channel());
  const auto set = [&](const std::string& name, const std::string& value) {
    grpc::ClientContext context;
    v1::SetLimitRequest request;
    request.set_name(name);
    request.set_value(value);
    v1::SetLimitReply reply;
    return admin->SetLimit(&context, request, &reply);
  };
  const auto shown = [&] {
    grpc::ClientContext context;
    v1::ListLimitsReply reply;
    EXPECT_TRUE(admin->ListLimits(&context, {}, &reply).ok());
    std::map<std::string, v1::LimitInfo> limits;
    for (const auto& limit : reply.limits()) limits[limit.name()] = limit;
    return limits;
  };
  EXPECT_EQ(shown().at("queue-limit").value(), "256");
  EXPECT_TRUE(shown().at("queue-limit").changeable());
  EXPECT_FALSE(shown().at("max-points").changeable());
  for (const auto& [name, value] :
       {std::pair{"queue-limit", "7"}, {"cache-budget", "1MiB"}, {"max-deadline", "1.5"}, {"max-connections", "9"}}) {
    EXPECT_THAT(set(name, value), EndedWith(StatusCode::OK)) << name;
    EXPECT_EQ(shown().at(name).value(), value);
    EXPECT_TRUE(shown().at(name).changed());
  }
  EXPECT_EQ(server.engine().info().queue_limit(), 7u);
  EXPECT_EQ(server.engine().info().cache_budget(), 1u << 20);
  for (const auto& [name, value] : {std::pair{"queue-limit", "0"},
                                    {"queue-limit", "many"},
                                    {"cache-budget", "900TiB"},
                                    {"max-deadline", "-1"},
                                    {"max-connections", "0"},
                                    {"max-points", "1"},
                                    {"log-level", "loud"}}) {
    EXPECT_THAT(set(name, value), EndedWith(StatusCode::INVALID_ARGUMENT)) << name << "=" << value;
  }
  EXPECT_THAT(set("queue-limits", "1"), EndedWith(StatusCode::NOT_FOUND));
  EXPECT_EQ(shown().at("queue-limit").value(), "7");
  grpc::ClientContext context;
  v1::ListConnectionsReply connections;
  ASSERT_TRUE(admin->ListConnections(&context, {}, &connections).ok());
  EXPECT_EQ(connections.limit(), 9u);
  ASSERT_EQ(connections.connections_size(), 1);
  EXPECT_EQ(connections.connections(0).peer().substr(0, 15), "ipv4:127.0.0.1:");
}

TEST(AdminLimits, AreTakenOverFromOptionsThatAreReadAgain) {
  ServerOptions options;
  options.limits = {{"max-points", "50000000"}};
  options.engine.memory_budget = std::size_t{1} << 30;
  support::InProcessServer server(support::Transport::loopback, options);
  RunningServer& running = server.running();
  EXPECT_EQ(running.take_over("queue-limit", "7"), "256");
  EXPECT_EQ(server.engine().info().queue_limit(), 7u);
  EXPECT_EQ(running.take_over("cache-budget", "1MiB"), "512MiB");
  EXPECT_EQ(running.take_over("cache-budget", "0"), "1MiB");
  EXPECT_EQ(server.engine().info().cache_budget(), std::size_t{512} << 20) << "0 is left to the server";
  EXPECT_EQ(running.take_over("max-deadline", "2.5"), "0");
  EXPECT_EQ(running.take_over("max-deadline", "0"), "2.5");
  const std::string all = running.take_over("max-connections", "9").value();
  EXPECT_EQ(running.take_over("max-connections", "0"), "9");
  EXPECT_EQ(running.take_over("max-connections", "9"), all);
  EXPECT_EQ(running.take_over("max-points", "1"), std::nullopt) << "takes a restart";
  EXPECT_EQ(running.take_over("workers", "1"), std::nullopt);
  EXPECT_EQ(running.take_over("data-dir", "/elsewhere"), std::nullopt);
  EXPECT_THROW(running.take_over("cache-budget", "900TiB"), Error);
  EXPECT_EQ(server.engine().info().cache_budget(), std::size_t{512} << 20);
}

}  // namespace
}  // namespace deform::server::admin_test
