// SPDX-License-Identifier: GPL-3.0-or-later
// Setups of more than one message, between the client and the server that both are real; no message reaches 1 MiB.
#include <grpcpp/create_channel.h>
#include <gtest/gtest.h>

#include "client/client.h"
#include "deform/v1/service.grpc.pb.h"
#include "tests/server/test_mesh.h"
#include "tests/support/expect_error.h"
#include "tests/support/in_process_server.h"

namespace deform::large_setups_test {
namespace {

using client::Client;
using client::SetupInInfo;
using test::expect_error;

constexpr int most_bytes = (1 << 20) - 1;

/// Fails a call with a message of 1 MiB, whoever sends it.
std::shared_ptr<grpc::Channel> strict_channel(const std::string& address) {
  grpc::ChannelArguments arguments;
  arguments.SetMaxSendMessageSize(most_bytes);
  arguments.SetMaxReceiveMessageSize(most_bytes);
  return grpc::CreateCustomChannel(address, grpc::InsecureChannelCredentials(), arguments);
}

class LargeSetups : public testing::Test {
 protected:
  LargeSetups() : server(support::Transport::loopback, options()), client(strict_channel(server.address()), {}) {
    client::GeometryArrays arrays;
    arrays.points = mesh.points;
    arrays.face_sizes = mesh.face_sizes;
    arrays.face_points = mesh.face_points;
    for (const auto& group : mesh.groups) arrays.groups.push_back({group.name, group.points, group.faces});
    setup = server::sheet_setup(client.register_geometry(arrays).id());
    small = client.prepare(setup);
  }
  static server::ServerOptions options() {
    server::ServerOptions options;
    options.engine.workers = 2;
    options.engine.memory_budget = std::size_t{1} << 30;
    return options;
  }
  /// Fixes some points again, by so many bytes of ids.
  void grow(std::size_t bytes) {
    v1::Region& region = *setup.add_fixed();
    v1::Region list;
    for (PointId id = 8'000; id < 9'000; ++id) {
      if (id % 100 >= 2 && id % 100 < 98) list.add_ids(id);  // two bytes each
    }
    for (std::size_t sent = 0; sent < bytes; sent += list.ByteSizeLong()) *region.add_union_() = list;
  }

  const Mesh mesh = server::sheet_mesh(100, 100);
  support::InProcessServer server;
  Client client;
  v1::Setup setup;
  v1::SystemInfo small;
};

TEST_F(LargeSetups, TenMebibytesArePreparedByMessagesBelowOne) {
  grow(std::size_t{10} << 20);
  const v1::EstimateReply estimate = client.estimate(setup);
  EXPECT_FALSE(estimate.resident());
  std::vector<std::string> stages;
  const v1::SystemInfo system = client.prepare(setup, {}, [&](const std::string& stage, double) { stages.push_back(stage); });
  EXPECT_EQ(system.id(), estimate.system_id());
  EXPECT_EQ(system.fixed_points(), small.fixed_points() + 10 * 96);
  EXPECT_FALSE(stages.empty());
  EXPECT_GT(system.setup_bytes(), std::size_t{10} << 20);
  EXPECT_EQ(system.setup().ByteSizeLong(), system.setup_bytes()) << "got by a call of its own";
  EXPECT_TRUE(client.estimate(setup).resident());

  const v1::Setup canonical = client.get_setup(system.id());
  EXPECT_EQ(canonical.SerializeAsString(), system.setup().SerializeAsString());
  EXPECT_EQ(client.prepare(canonical, {}, {}, SetupInInfo::omit).id(), system.id()) << "the canonical setup is that setup";

  for (const SetupInInfo wanted : {SetupInInfo::include, SetupInInfo::omit}) {
    const bool has = wanted == SetupInInfo::include;
    EXPECT_EQ(client.prepare(setup, {}, {}, wanted).has_setup(), has);
    EXPECT_EQ(client.get_system(system.id(), {}, wanted).has_setup(), has);
    for (const auto& listed : client.list_systems({}, wanted)) EXPECT_EQ(listed.has_setup(), has);
  }
  v1::EstimateRequest wrong;
  *wrong.mutable_setup() = setup;
  wrong.mutable_setup()->mutable_handles(0)->set_name("");
  wrong.set_list_problems(true);
  EXPECT_GT(client.estimate(wrong).problems_size(), 0);
}

TEST_F(LargeSetups, DesignsOfALargeSetupSurviveARestart) {
  grow(std::size_t{2} << 20);
  const v1::SystemInfo system = client.prepare(setup);
  v1::DeformRequest request;
  request.set_system_id(system.id());
  request.add_designs();
  for (int i = 0; i < setup.variables_size(); ++i) request.mutable_designs(0)->add_variables(0.01);
  const Points before = client.deform(request).designs.at(0).points;
  server.restart();
  Client again(strict_channel(server.address()), {});
  const auto outcome = again.deform(request);
  EXPECT_TRUE(outcome.summary.prepared_again());
  EXPECT_EQ(outcome.designs.at(0).points, before);
}

/// One message of up to 4 MiB is what clients of versions before this one send.
TEST_F(LargeSetups, OneMessageIsTakenAsBeforeAndAnsweredWithoutTheSetup) {
  grow(std::size_t{2} << 20);
  const auto channel = grpc::CreateChannel(server.address(), grpc::InsecureChannelCredentials());
  const auto stub = v1::DeformService::NewStub(channel);
  v1::PrepareRequest request;
  *request.mutable_setup() = setup;
  grpc::ClientContext context;
  const auto stream = stub->Prepare(&context, request);
  v1::PrepareReply reply;
  while (stream->Read(&reply)) EXPECT_LT(reply.ByteSizeLong(), std::size_t{1} << 20);
  EXPECT_TRUE(stream->Finish().ok());
  EXPECT_FALSE(reply.system().has_setup());
  EXPECT_GT(reply.system().setup_bytes(), std::size_t{2} << 20);
  EXPECT_EQ(client.prepare(setup).id(), reply.system().id());
}

TEST_F(LargeSetups, WhatIsTooLargeIsRefusedWithTheLimit) {
  grow(std::size_t{65} << 20);
  expect_error(ErrorCode::invalid_argument, {"header.setup.bytes", "67108864"}, [&] { client.prepare(setup); });
  expect_error(ErrorCode::invalid_argument, {"header.setup.bytes", "67108864"}, [&] { client.estimate(setup); });
}

}  // namespace
}  // namespace deform::large_setups_test
