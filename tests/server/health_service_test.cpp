// SPDX-License-Identifier: GPL-3.0-or-later
// The health service: what it answers, and what calls that stay open may take. As clients of other languages have it, by gRPC's
// contract.
#include "server/rpc/health_service.h"

#include <atomic>
#include <chrono>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "grpc/health/v1/health.grpc.pb.h"
#include "tests/server/ended_with.h"
#include "tests/server/service_fixture.h"

namespace deform::server::health_service_test {
namespace {

namespace health = grpc::health::v1;
using grpc::StatusCode;
using Reply = health::HealthCheckResponse;

health::HealthCheckRequest about(const std::string& service) {
  health::HealthCheckRequest request;
  request.set_service(service);
  return request;
}

/// One Watch of a client.
class Watcher {
 public:
  Watcher(health::Health::Stub& stub, const std::string& service) : reader_(stub.Watch(&context_, about(service))) {}
  ~Watcher() { context_.TryCancel(); }

  /// The next status; -1 when the call has ended.
  int next() {
    Reply reply;
    return reader_->Read(&reply) ? reply.status() : -1;
  }
  grpc::Status finish() { return reader_->Finish(); }
  const grpc::ClientContext& context() const { return context_; }

 private:
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReader<Reply>> reader_;
};

class Health : public ServiceFixture {
 protected:
  void start_server(const ServiceOptions& options = {}) {
    start(options);
    health_stub = health::Health::NewStub(channel);
  }
  grpc::Status check(const std::string& service, Reply& reply) {
    grpc::ClientContext context;
    return health_stub->Check(&context, about(service), &reply);
  }
  /// A design that keeps a server that stops waiting, until end_work().
  void begin_work() {
    work_ = stub->Deform(&work_context_, {});
    job_ = engine.job(0);
  }
  void end_work() {
    job_->end();
    EXPECT_THAT(work_->Finish(), EndedWith(StatusCode::OK));
  }

  std::unique_ptr<health::Health::Stub> health_stub;

 private:
  grpc::ClientContext work_context_;
  std::unique_ptr<grpc::ClientReader<v1::DeformReply>> work_;
  std::shared_ptr<support::FakeJob> job_;
};

TEST_P(Health, CheckKnowsItsServicesAndNoOther) {
  start_server();
  Reply reply;
  EXPECT_THAT(check("", reply), EndedWith(StatusCode::OK));
  EXPECT_EQ(reply.status(), Reply::SERVING);
  EXPECT_THAT(check("deform.v1.DeformService", reply), EndedWith(StatusCode::OK));
  EXPECT_THAT(check("deform.v1.Other", reply), EndedWith(StatusCode::NOT_FOUND));
  EXPECT_THAT(check(std::string(200, 'a'), reply), EndedWith(StatusCode::NOT_FOUND));
  EXPECT_THAT(check(std::string(201, 'a'), reply), EndedWith(StatusCode::INVALID_ARGUMENT));
}

TEST_P(Health, WatchTellsEveryChangeAndEndsWithTheServer) {
  start_server();
  Watcher whole(*health_stub, ""), unknown(*health_stub, "deform.v1.Other"), too_long(*health_stub, std::string(201, 'a'));
  EXPECT_EQ(whole.next(), Reply::SERVING);
  EXPECT_EQ(unknown.next(), Reply::SERVICE_UNKNOWN);
  EXPECT_EQ(too_long.next(), -1);
  EXPECT_THAT(too_long.finish(), EndedWith(StatusCode::INVALID_ARGUMENT));
  begin_work();
  std::thread stopper([&] { server->running().stop(std::chrono::seconds(60)); });
  EXPECT_EQ(whole.next(), Reply::NOT_SERVING);
  EXPECT_EQ(whole.next(), -1);
  EXPECT_THAT(whole.finish(), EndedWith(StatusCode::UNAVAILABLE));
  EXPECT_EQ(unknown.next(), -1);
  end_work();
  stopper.join();
}

TEST_P(Health, NobodyWhoWatchesKeepsTheServerFromStopping) {
  start_server();
  Watcher reads_no_more(*health_stub, "");
  EXPECT_EQ(reads_no_more.next(), Reply::SERVING);
  EXPECT_TRUE(server->running().stop(std::chrono::seconds(60))) << "the time to stop is not waited for";
}

TEST_P(Health, ManyChangesWhileManyWatchLeaveEverybodyWithTheLast) {
  start_server();
  constexpr int watchers = 20;
  std::vector<std::thread> threads;
  std::vector<int> last(watchers, 0);
  std::atomic<int> watching{0};
  for (int i = 0; i < watchers; ++i) {
    threads.emplace_back([&, i] {
      Watcher watcher(*health_stub, "deform.v1.DeformService/write");
      last[static_cast<std::size_t>(i)] = watcher.next();
      ++watching;
      for (int status = 0; status != -1;) {
        status = watcher.next();
        if (status != -1) last[static_cast<std::size_t>(i)] = status;
      }
    });
  }
  EXPECT_TRUE(support::eventually([&] { return watching == watchers; }));
  begin_work();
  std::thread stopper([&] { server->running().stop(std::chrono::seconds(60)); });
  for (std::thread& thread : threads) thread.join();
  end_work();
  stopper.join();
  EXPECT_EQ(last, std::vector<int>(watchers, Reply::NOT_SERVING));
}

TEST_P(Health, CallsThatWatchAreCountedAndRefusedBeyondTheLimit) {
  ServiceOptions options;
  options.max_calls = 10;
  start_server(options);
  std::vector<std::unique_ptr<Watcher>> watchers;
  for (int i = 0; i < 8; ++i) {
    watchers.push_back(std::make_unique<Watcher>(*health_stub, ""));
    ASSERT_EQ(watchers.back()->next(), Reply::SERVING) << i;
  }
  Watcher refused(*health_stub, "");
  EXPECT_EQ(refused.next(), -1);
  const grpc::Status status = refused.finish();
  EXPECT_THAT(status, EndedWith(StatusCode::RESOURCE_EXHAUSTED));
  EXPECT_NE(status.error_message().find("--max-calls"), std::string::npos) << status.error_message();
  EXPECT_FALSE(retry_hint(refused.context()).empty());
  // Other calls of this client are refused, too, and taken again when those that watch have left.
  const auto ask = [&] {
    grpc::ClientContext context;
    v1::GeometryInfo reply;
    return stub->GetGeometry(&context, {}, &reply);
  };
  EXPECT_THAT(ask(), EndedWith(StatusCode::RESOURCE_EXHAUSTED));
  Reply reply;
  EXPECT_THAT(check("", reply), EndedWith(StatusCode::OK)) << "a probe is always answered";
  watchers.clear();
  EXPECT_TRUE(support::eventually([&] { return ask().ok(); }));
}

DEFORM_BOTH_TRANSPORTS(Health);

}  // namespace
}  // namespace deform::server::health_service_test
