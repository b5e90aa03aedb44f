// SPDX-License-Identifier: GPL-3.0-or-later
// Starting and stopping: drain with live calls of every kind, within the limit; addresses.
#include "server/rpc/server.h"

#include <grpcpp/generic/generic_stub.h>

#include <mutex>
#include <thread>
#include <vector>

#include "tests/server/service_fixture.h"
#include "tests/server/sockets.h"

namespace deform::server::server_test {
namespace {

using grpc::StatusCode;
using std::chrono::milliseconds;
using std::chrono::seconds;
using support::eventually;

/// SERVING is 1, NOT_SERVING 2.
int health_of(const std::shared_ptr<grpc::Channel>& channel, const std::string& service) {
  std::string request;
  if (!service.empty()) request = "\n" + std::string(1, static_cast<char>(service.size())) + service;
  const grpc::Slice slice(request);
  grpc::GenericStub generic(channel);
  grpc::ClientContext context;
  grpc::CompletionQueue queue;
  auto call = generic.PrepareUnaryCall(&context, "/grpc.health.v1.Health/Check", grpc::ByteBuffer(&slice, 1), &queue);
  call->StartCall();
  grpc::ByteBuffer reply;
  grpc::Status status;
  call->Finish(&reply, &status, nullptr);
  void* tag = nullptr;
  bool ok = false;
  queue.Next(&tag, &ok);
  grpc::Slice answer;
  if (!status.ok() || !reply.DumpToSingleSlice(&answer).ok() || answer.size() != 2) return -1;
  return answer.begin()[1];
}

class ServerStop : public ServiceFixture {
 protected:
  /// Stops and says how long it took.
  std::chrono::duration<double> timed_stop(milliseconds grace) {
    const auto begin = std::chrono::steady_clock::now();
    clean = server->running().stop(grace);
    return std::chrono::steady_clock::now() - begin;
  }
  int health() { return health_of(channel, ""); }
  bool clean = false;
};

TEST_P(ServerStop, WithNothingUnderWayIsQuickAndClean) {
  start();
  EXPECT_LT(timed_stop(seconds(30)), seconds(2));
  EXPECT_TRUE(clean);
  EXPECT_TRUE(server->running().stop(seconds(0))) << "again, nothing happens";
}

TEST_P(ServerStop, WaitsForADeformThatEndsInTime) {
  start();
  grpc::ClientContext context;
  v1::DeformRequest request;
  const auto reader = stub->Deform(&context, request);
  const auto job = engine.job(0);
  std::thread ender([&] {
    std::this_thread::sleep_for(milliseconds(100));
    job->push_block(1);
    job->end();
  });
  std::thread stopper([&] { EXPECT_LT(timed_stop(seconds(20)), seconds(5)); });
  v1::DeformReply reply;
  EXPECT_TRUE(reader->Read(&reply));
  EXPECT_FALSE(reader->Read(&reply));
  EXPECT_TRUE(reader->Finish().ok());
  ender.join();
  stopper.join();
  EXPECT_TRUE(clean);
}

TEST_P(ServerStop, CancelsADeformThatTakesTooLong) {
  start();
  grpc::ClientContext context;
  const auto reader = stub->Deform(&context, {});
  const auto job = engine.job(0);
  EXPECT_LT(timed_stop(milliseconds(200)), seconds(3));
  EXPECT_FALSE(clean);
  EXPECT_TRUE(job->cancelled());
  EXPECT_FALSE(reader->Finish().ok());
}

TEST_P(ServerStop, EndsWithAnUploadInProgress) {
  start();
  grpc::ClientContext context;
  v1::GeometryInfo info;
  const auto writer = stub->RegisterGeometry(&context, &info);
  v1::RegisterGeometryRequest header;
  header.mutable_header()->set_point_count(10);
  writer->Write(header);
  const auto upload = engine.upload(0);
  EXPECT_LT(timed_stop(milliseconds(200)), seconds(3));
  EXPECT_FALSE(writer->Finish().ok());
  EXPECT_TRUE(eventually([&] { return upload->destroyed.load(); }));
  EXPECT_FALSE(upload->finished);
}

TEST_P(ServerStop, EndsWithReadersThatDoNotRead) {
  engine.on_job = [](support::FakeJob& job) {
    for (std::uint32_t i = 0; i < 50; ++i) job.push_block(i, 900'000);
    job.end();
  };
  start();
  grpc::ClientContext contexts[3];
  const auto deform = stub->Deform(&contexts[0], {});
  const auto points = stub->GetPoints(&contexts[1], {});
  const auto stream = stub->DeformStream(&contexts[2]);
  v1::DeformStreamRequest request;
  request.mutable_request();
  stream->Write(request);
  engine.job(1);
  EXPECT_LT(timed_stop(milliseconds(200)), seconds(3));
  v1::DeformReply reply;
  while (deform->Read(&reply)) {
  }
  while (stream->Read(&reply)) {
  }
  v1::PointChunk chunk;
  while (points->Read(&chunk)) {
  }
  deform->Finish();
  stream->Finish();
  points->Finish();
}

TEST_P(ServerStop, EndsWithAPreparationThatNeverAnswers) {
  std::function<void(Engine::Outcome<v1::SystemInfo>)> never;
  engine.on_prepare = [&](const v1::PrepareRequest&, const CallContext&, auto, auto on_done) { never = on_done; };
  start();
  grpc::ClientContext context;
  const auto reader = stub->Prepare(&context, {});
  EXPECT_TRUE(eventually([&] { return static_cast<bool>(never); }));
  EXPECT_LT(timed_stop(milliseconds(200)), seconds(3));
  EXPECT_FALSE(reader->Finish().ok());
}

TEST_P(ServerStop, HealthSaysNotServingWhileDrainingAndNewWorkIsRefused) {
  start();
  EXPECT_EQ(health(), 1);
  grpc::ClientContext context;
  const auto reader = stub->Deform(&context, {});
  const auto job = engine.job(0);
  std::thread stopper([&] { timed_stop(seconds(20)); });
  EXPECT_TRUE(eventually([&] { return health() == 2; }));
  EXPECT_TRUE(eventually([&] {
    grpc::ClientContext late;  // may still be taken in, and never be answered
    late.set_deadline(std::chrono::system_clock::now() + milliseconds(200));
    return stub->Deform(&late, {})->Finish().error_code() == StatusCode::UNAVAILABLE;
  }));
  job->end();
  stopper.join();
  EXPECT_TRUE(reader->Finish().ok());
}

DEFORM_BOTH_TRANSPORTS(ServerStop);

ServerOptions at(const std::string& address) {
  ServerOptions options;
  options.address = address;
  return options;
}

/// Its store has room or not, as the test says.
class EngineOnADisk : public support::FakeEngine {
 public:
  explicit EngineOnADisk(std::shared_ptr<std::atomic<bool>> room) : room_(std::move(room)) {}
  v1::StoreInfo store() override {
    v1::StoreInfo info;
    info.set_writable(*room_);
    return info;
  }

 private:
  const std::shared_ptr<std::atomic<bool>> room_;
};

TEST(Server, HealthTellsWhetherTheStoreCanBeAddedTo) {
  const auto room = std::make_shared<std::atomic<bool>>(false);
  const auto server = start_server(at(""), std::make_unique<EngineOnADisk>(room));
  const auto channel = server->in_process_channel();
  EXPECT_EQ(health_of(channel, "deform.v1.DeformService/write"), 2);
  EXPECT_EQ(health_of(channel, ""), 1) << "what is there is served all the same";
  EXPECT_EQ(health_of(channel, "deform.v1.DeformService"), 1);
  *room = true;
  EXPECT_TRUE(eventually([&] { return health_of(channel, "deform.v1.DeformService/write") == 1; }));
  *room = false;
  EXPECT_TRUE(eventually([&] { return health_of(channel, "deform.v1.DeformService/write") == 2; }));
}

/// There is room from the second time on that it is asked.
class EngineWithRoomSoon : public support::FakeEngine {
 public:
  v1::StoreInfo store() override {
    v1::StoreInfo info;
    info.set_writable(asked_++ > 0);
    return info;
  }

 private:
  std::atomic<int> asked_ = 0;
};

TEST(Server, RoomThatComesWhileTheServerStartsIsTold) {
  const auto server = start_server(at(""), std::make_unique<EngineWithRoomSoon>());
  const auto channel = server->in_process_channel();
  EXPECT_TRUE(eventually([&] { return health_of(channel, "deform.v1.DeformService/write") == 1; }));
}

/// Budgeted so small that what the test itself allocates is too much.
class EngineWithABudget : public support::FakeEngine {
 public:
  v1::ServerInfo info() override {
    v1::ServerInfo info;
    info.set_memory_budget(std::size_t{100} << 20);
    return info;
  }
  void give_back_idle_memory(std::size_t bytes) override { asked_back = bytes; }
  std::atomic<std::size_t> asked_back{0};
};

TEST(Server, AFullProcessRefusesWhatComputesAndServesTheRest) {
  auto owned = std::make_unique<EngineWithABudget>();
  EngineWithABudget& engine = *owned;
  const auto server = start_server(at(""), std::move(owned));
  const auto stub = v1::DeformService::NewStub(server->in_process_channel());
  const auto estimate = [&](std::string* hint = nullptr) {
    grpc::ClientContext context;
    v1::EstimateReply reply;
    const auto code = stub->Estimate(&context, {}, &reply).error_code();
    const auto& trailing = context.GetServerTrailingMetadata();
    if (const auto found = trailing.find("retry-after-ms"); hint != nullptr && found != trailing.end())
      hint->assign(found->second.data(), found->second.size());
    return code;
  };
  const auto info = [&] {
    grpc::ClientContext context;
    v1::ServerInfo reply;
    return stub->GetServerInfo(&context, {}, &reply).error_code();
  };
  EXPECT_EQ(estimate(), StatusCode::OK);
  auto ballast = std::make_unique<std::vector<char>>(std::size_t{128} << 20, 'x');
  EXPECT_TRUE(eventually([&] { return estimate() == StatusCode::RESOURCE_EXHAUSTED; }));
  std::string hint;
  estimate(&hint);
  EXPECT_EQ(hint, "1000");
  EXPECT_EQ(info(), StatusCode::OK);
  EXPECT_GT(engine.asked_back, 0u) << "idle memory first";
  ballast.reset();
  EXPECT_TRUE(eventually([&] { return estimate() == StatusCode::OK; }));
}

TEST(Server, TwoServersDoNotShareAPort) {
  const auto first = start_server(at("127.0.0.1:0"), std::make_unique<support::FakeEngine>());
  EXPECT_GT(first->port(), 0);
  EXPECT_EQ(first->address(), "127.0.0.1:" + std::to_string(first->port()));
  try {
    start_server(at(first->address()), std::make_unique<support::FakeEngine>());
    FAIL() << "both listen on " << first->address();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::unavailable);
    EXPECT_NE(std::string(error.what()).find(first->address()), std::string::npos);
  }
}

/// What the operations port answers.
std::string answer_of(int port, const std::string& path) {
  const int fd = connected_to(port);
  const std::string request = "GET " + path + " HTTP/1.1\r\nHost: a\r\nConnection: close\r\n\r\n";
  EXPECT_EQ(send(fd, request.data(), request.size(), MSG_NOSIGNAL), static_cast<ssize_t>(request.size()));
  std::string answer;
  char bytes[4096];
  for (ssize_t got = 0; (got = recv(fd, bytes, sizeof(bytes), 0)) > 0;) answer.append(bytes, static_cast<std::size_t>(got));
  close(fd);
  return answer;
}

int free_port() {
  const int fd = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address = loopback(0);
  socklen_t size = sizeof(address);
  EXPECT_EQ(bind(fd, reinterpret_cast<const sockaddr*>(&address), size), 0);
  EXPECT_EQ(getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size), 0);
  close(fd);
  return ntohs(address.sin_port);
}

TEST(Server, WhoeverStartedItIsToldThatItAcceptsNoMore) {
  ServerOptions options = at("127.0.0.1:0");
  const int operations = free_port();
  options.metrics_address = "127.0.0.1:" + std::to_string(operations);
  std::mutex mutex;
  std::vector<std::string> told;
  options.on_failure = [&](const std::string& why) {
    const std::lock_guard lock(mutex);
    told.push_back(why);
  };
  const auto server = start_server(options, std::make_unique<support::FakeEngine>());
  const auto ready = [&] { return answer_of(operations, "/readyz"); };
  EXPECT_NE(ready().find("[+] accepting\n"), std::string::npos) << ready();
  ASSERT_EQ(shutdown(listening_at(server->port()), SHUT_RDWR), 0);
  EXPECT_TRUE(eventually([&] {
    const std::lock_guard lock(mutex);
    return !told.empty();
  }));
  EXPECT_NE(ready().find("503"), std::string::npos) << ready();
  EXPECT_NE(ready().find("[-] accepting: nothing can be accepted from a socket that is listened on"), std::string::npos)
      << ready();
  std::this_thread::sleep_for(milliseconds(200));
  const std::lock_guard lock(mutex);
  EXPECT_EQ(told, std::vector<std::string>{"no more connections are accepted: nothing can be accepted from a socket that is "
                                           "listened on: Invalid argument"});
}

TEST(Server, ListensOnAUnixSocket) {
  const support::TemporaryFolder folder;
  const std::string address = "unix:" + (folder.path() / "socket").string();
  const auto server = start_server(at(address), std::make_unique<support::FakeEngine>());
  const auto stub = v1::DeformService::NewStub(grpc::CreateChannel(address, grpc::InsecureChannelCredentials()));
  grpc::ClientContext context;
  v1::ServerInfo info;
  EXPECT_TRUE(stub->GetServerInfo(&context, {}, &info).ok());
  const auto mode = std::filesystem::status(folder.path() / "socket").permissions();
  EXPECT_EQ(static_cast<unsigned>(mode), 0660u) << "its owner and its group may connect";
}

TEST(Server, ReflectionIsOnUnlessItIsTurnedOff) {
  for (const Reflection wanted : {Reflection::on, Reflection::off}) {
    ServerOptions options = at("");
    options.reflection = wanted;
    const auto server = start_server(options, std::make_unique<support::FakeEngine>());
    grpc::GenericStub generic(server->in_process_channel());
    grpc::ClientContext context;
    grpc::CompletionQueue queue;
    const auto wait = [&queue] {
      void* tag = nullptr;
      bool ok = false;
      queue.Next(&tag, &ok);
    };
    const auto stream = generic.PrepareCall(&context, "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo", &queue);
    stream->StartCall(nullptr);
    wait();
    stream->WritesDone(nullptr);
    wait();
    grpc::Status status;
    stream->Finish(&status, nullptr);
    wait();
    EXPECT_EQ(status.error_code(), wanted == Reflection::on ? StatusCode::OK : StatusCode::UNIMPLEMENTED);
    EXPECT_EQ(health_of(server->in_process_channel(), ""), 1);
  }
}

TEST(Server, BadOptionsAreRefusedBeforeAnythingStarts) {
  for (const char* address : {"nowhere", "0.0.0.0:0", "[::]:0"}) {
    EXPECT_THROW(start_server(at(address), std::make_unique<support::FakeEngine>()), Error) << address;
  }
  ServerOptions options = at("");
  options.service.call_threads = 0;
  EXPECT_THROW(start_server(options, std::make_unique<support::FakeEngine>()), Error);
}

}  // namespace
}  // namespace deform::server::server_test
