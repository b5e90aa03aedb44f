// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <utility>

#include "deform/v1/service.grpc.pb.h"
#include "tests/support/fake_engine.h"
#include "tests/support/in_process_server.h"

namespace deform::server {

/// The real service in front of an engine that the test plays, over both transports: they end calls differently underneath.
class ServiceFixture : public testing::TestWithParam<support::Transport> {
 protected:
  ~ServiceFixture() override {
    if (!server) return;
    // Whatever a test did, every call must have come to its end.
    const auto start = std::chrono::steady_clock::now();
    server->running().stop(std::chrono::milliseconds(0));
    EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(5)) << "a call never finished";
  }

  /// Call after the scripts of `engine` are set.
  void start(const ServiceOptions& options = {}) {
    server = std::make_unique<support::InProcessServer>(GetParam(), std::move(owned_), options);
    channel = server->channel();
    stub = v1::DeformService::NewStub(channel);
  }

  static std::string retry_hint(const grpc::ClientContext& context) {
    const auto& trailing = context.GetServerTrailingMetadata();
    const auto found = trailing.find("retry-after-ms");
    return found == trailing.end() ? "" : std::string(found->second.data(), found->second.size());
  }

  std::unique_ptr<support::FakeEngine> owned_ = std::make_unique<support::FakeEngine>();
  support::FakeEngine& engine = *owned_;
  std::unique_ptr<support::InProcessServer> server;
  std::shared_ptr<grpc::Channel> channel;
  std::unique_ptr<v1::DeformService::Stub> stub;
};

inline std::string transport_name(const testing::TestParamInfo<support::Transport>& info) {
  return info.param == support::Transport::in_process ? "InProcess" : "Loopback";
}

#define DEFORM_BOTH_TRANSPORTS(fixture)                                                                                        \
  INSTANTIATE_TEST_SUITE_P(Transports, fixture, testing::Values(support::Transport::in_process, support::Transport::loopback), \
                           transport_name)

}  // namespace deform::server
