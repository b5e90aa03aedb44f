// SPDX-License-Identifier: GPL-3.0-or-later
// A client with several servers, which the tests play: each one knows what was registered and prepared there, and may be stopped.
#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <thread>

#include "client/address.h"
#include "client/client.h"
#include "client/servers.h"
#include "client/unfinished_designs.h"
#include "tests/client/scripted_service.h"
#include "tests/support/expect_error.h"

namespace deform::several_servers_test {
namespace {

using client::Client;
using client::ClientOptions;
using test::expect_error;
using test::ReplyScript;
using test::ScriptedService;

const grpc::Status unknown_there(grpc::StatusCode::NOT_FOUND, "there is none");

/// Forgets nothing until it is stopped. The systems of a geometry have its id and "s" in front.
struct PlayedServer {
  PlayedServer() {
    service.on_get_geometry = [this](const v1::GetGeometryRequest& request, v1::GeometryInfo& info) {
      const std::lock_guard lock(mutex);
      if (!geometries.contains(request.id())) return unknown_there;
      info.set_id(request.id());
      return grpc::Status::OK;
    };
    service.on_register = [this](grpc::ServerReaderInterface<v1::RegisterGeometryRequest>& reader, v1::GeometryInfo& info) {
      v1::RegisterGeometryRequest message;
      while (reader.Read(&message)) {
        if (message.has_header()) info.set_id(message.header().id());
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(upload_ms));
      const std::lock_guard lock(mutex);
      geometries.insert(info.id());
      ++uploads;
      return grpc::Status::OK;
    };
    service.on_prepare = [this](const v1::PrepareRequest& request, grpc::ServerWriterInterface<v1::PrepareReply>& writer) {
      const std::lock_guard lock(mutex);
      if (!geometries.contains(request.setup().geometry())) return unknown_there;
      v1::PrepareReply reply;
      reply.mutable_system()->set_id("s" + request.setup().geometry());
      reply.mutable_system()->set_geometry_id(request.setup().geometry());
      systems.insert(reply.system().id());
      writer.Write(reply, {});
      return grpc::Status::OK;
    };
    service.on_deform = [this](grpc::ServerContext& context, const v1::DeformRequest& request, ScriptedService::Writer& writer) {
      note_geometry(context);
      const std::lock_guard lock(mutex);
      ++asked;
      if (!systems.contains(request.system_id())) return unknown_there;
      for (const auto& reply : answers(request, 0)) writer.Write(reply, {});
      ++answered;
      return grpc::Status::OK;
    };
    service.on_stream = [this](grpc::ServerContext& context, ScriptedService::Stream& stream) {
      ++streams;
      note_geometry(context);
      v1::DeformStreamRequest message;
      std::string system;  // the first message of a request names it
      while (stream.Read(&message)) {
        if (!message.request().system_id().empty()) system = message.request().system_id();
        if (message.more()) continue;
        if (answers_left.fetch_sub(1) <= 0) return grpc::Status(grpc::StatusCode::UNAVAILABLE, "going down");
        const std::lock_guard lock(mutex);
        if (!systems.contains(system)) {
          v1::DeformReply reply;
          reply.set_request_id(message.request_id());
          reply.mutable_error()->set_code(grpc::StatusCode::NOT_FOUND);
          reply.mutable_error()->set_message("there is none");
          stream.Write(reply, {});
          continue;
        }
        for (const auto& reply : answers(message.request(), message.request_id())) stream.Write(reply, {});
        ++answered;
      }
      return grpc::Status::OK;
    };
    service.on_delete = [this](const v1::DeleteGeometryRequest& request) {
      const std::lock_guard lock(mutex);
      return geometries.erase(request.id()) == 0 ? unknown_there : grpc::Status::OK;
    };
    service.on_list = [this](const v1::ListGeometriesRequest&, v1::ListGeometriesReply& reply) {
      const std::lock_guard lock(mutex);
      for (const auto& id : geometries) reply.add_geometries()->set_id(id);
      return grpc::Status::OK;
    };
  }

  void note_geometry(const grpc::ServerContext& context) {
    const auto found = context.client_metadata().find("x-geometry-id");
    const std::lock_guard lock(mutex);
    told = found == context.client_metadata().end() ? "" : std::string(found->second.data(), found->second.size());
  }

  static std::vector<v1::DeformReply> answers(const v1::DeformRequest& request, std::uint64_t id) {
    ReplyScript script;
    script.request_id = id;
    script.designs = static_cast<std::size_t>(request.designs_size());
    return test::replies(script);
  }

  std::mutex mutex;
  // under mutex
  std::set<std::string> geometries, systems;
  std::string told;  ///< x-geometry-id of the last deformation or session
  std::atomic<int> uploads{0}, asked{0}, answered{0}, streams{0};
  std::atomic<int> upload_ms{0};
  std::atomic<int> answers_left{1'000'000};  ///< of streams, before one breaks
  ScriptedService service;
};

class SeveralServers : public testing::Test {
 protected:
  static constexpr std::size_t count = 3;

  ClientOptions options() const {
    ClientOptions options;
    options.address.clear();
    options.patience = std::chrono::milliseconds(0);  // else each of those that end with an error takes half a minute
    for (const auto& server : servers_) options.address += (options.address.empty() ? "" : ",") + server->service.address();
    return options;
  }

  /// A geometry of its own for each number.
  static v1::GeometryInfo registered(Client& client, double number) {
    const Points points = {{0, 0, 0}, {1, 0, 0}, {0, 1, number}};
    const std::vector<std::uint32_t> sizes = {3}, corners = {0, 1, 2};
    return client.register_geometry({points, sizes, corners, {}, "triangle", {}});
  }

  /// Its system.
  static std::string prepared(Client& client, double number) {
    v1::Setup setup;
    setup.set_geometry(registered(client, number).id());
    const std::string system = client.prepare(setup).id();
    client.keep_points("geometry", std::make_shared<const Points>(test::registered_points(5000)));
    return system;
  }

  static v1::DeformRequest request(const std::string& system, int designs = 1) {
    v1::DeformRequest request;
    request.set_system_id(system);
    request.mutable_output()->set_encoding(v1::RAW_F64);
    for (int d = 0; d < designs; ++d) request.add_designs();
    return request;
  }

  static void expect_design(const client::DeformOutcome& outcome) {
    ASSERT_EQ(outcome.designs.size(), 1u);
    EXPECT_EQ(outcome.designs[0].points, test::deformed_points(5000, 0));
  }

  /// That has the system; the only one.
  PlayedServer& owner(const std::string& system) {
    PlayedServer* found = nullptr;
    for (const auto& server : servers_) {
      if (!server->systems.contains(system)) continue;
      EXPECT_EQ(found, nullptr) << "two have it";
      found = server.get();
    }
    EXPECT_NE(found, nullptr);
    return *found;
  }

  int uploads() const {
    int sum = 0;
    for (const auto& server : servers_) sum += server->uploads;
    return sum;
  }

  std::array<std::unique_ptr<PlayedServer>, count> servers_ = {std::make_unique<PlayedServer>(), std::make_unique<PlayedServer>(),
                                                               std::make_unique<PlayedServer>()};
};

TEST(ServersOfAClient, AddressesOfAListAreCheckedOneByOne) {
  EXPECT_EQ(client::addresses_of("a:1"), std::vector<std::string>{"a:1"});
  EXPECT_EQ(client::addresses_of("a:1, [::1]:2 ,unix:/x"), (std::vector<std::string>{"a:1", "[::1]:2", "unix:/x"}));
  expect_error(ErrorCode::invalid_argument, {"\"a:1,\"", "empty"}, [] { client::addresses_of("a:1,"); });
  expect_error(ErrorCode::invalid_argument, {"\"b\"", "has no port"}, [] { client::addresses_of("a:1,b"); });
  expect_error(ErrorCode::invalid_argument, {"a:1 stands there twice"}, [] { client::addresses_of("a:1,b:1,a:1"); });
  EXPECT_EQ(client::encoding_for("127.0.0.1:1,unix:/x"), v1::RAW_F64);
  EXPECT_EQ(client::encoding_for("127.0.0.1:1,far:1"), v1::DELTA_ZSTD);
}

TEST(ServersOfAClient, TokensGoToOtherMachinesByTlsOnly) {
  ClientOptions options;
  options.address = "127.0.0.1:1,far:1";
  options.token_file = "token";
  expect_error(ErrorCode::invalid_argument, {"token_file", "far:1"}, [&] { Client client(options); });
}

client::Servers named_servers(const std::vector<std::string>& addresses) {
  std::vector<std::unique_ptr<client::Server>> servers;
  const auto nobody = grpc::CreateChannel("127.0.0.1:1", grpc::InsecureChannelCredentials());
  for (const auto& address : addresses) servers.push_back(std::make_unique<client::Server>(address, nobody));
  return client::Servers(std::move(servers));
}

std::vector<std::string> ranked(const client::Servers& servers, const std::string& key) {
  std::vector<std::string> addresses;
  for (const auto* server : servers.ranked(key)) addresses.push_back(server->address);
  return addresses;
}

TEST(ServersOfAClient, EveryKeyHasItsOrderWhateverTheOrderOfTheList) {
  const auto all = named_servers({"a:1", "b:1", "c:1", "d:1"});
  const auto other_order = named_servers({"d:1", "b:1", "a:1", "c:1"});
  const auto without_c = named_servers({"a:1", "b:1", "d:1"});
  std::map<std::string, int> first, second;
  constexpr int keys = 8000;
  for (int k = 0; k < keys; ++k) {
    const std::string key = std::to_string(k * 7919);
    auto order = ranked(all, key);
    EXPECT_EQ(order, ranked(other_order, key));
    ++first[order[0]];
    ++second[order[0] + order[1]];
    std::erase(order, "c:1");
    EXPECT_EQ(order, ranked(without_c, key)) << "only the keys of the one that went move";
  }
  // Five standard deviations around equal shares, and equal shares of what the first one leaves.
  for (const auto& [server, share] : first) EXPECT_NEAR(share, keys / 4, 5 * 39) << server;
  ASSERT_EQ(second.size(), 12u);
  for (const auto& [pair, share] : second) EXPECT_NEAR(share, keys / 12, 5 * 25) << pair;
  EXPECT_EQ(ranked(all, ""), (std::vector<std::string>{"a:1", "b:1", "c:1", "d:1"}));
  EXPECT_EQ(ranked(all, "0123"), (std::vector<std::string>{"b:1", "d:1", "c:1", "a:1"})) << "clients of all versions agree";
}

TEST_F(SeveralServers, EachGeometryIsOnOneOfThem) {
  Client client(options());
  std::map<PlayedServer*, int> owned;
  for (int k = 0; k < 24; ++k) {
    const std::string system = prepared(client, k);
    PlayedServer& at = owner(system);
    ++owned[&at];
    const int before = at.asked;
    expect_design(client.deform(request(system)));
    EXPECT_EQ(at.asked, before + 1);
    EXPECT_EQ("s" + at.told, system) << "for proxies that choose by it";
    at.told.clear();
    client.open_session()->submit(request(system)).get();
    EXPECT_EQ("s" + at.told, system);
    at.told.clear();
    v1::DeformRequest large = request(system);
    large.mutable_designs(0)->add_motions()->add_displacements()->set_xyz(std::string(48 * 20'000, '\0'));
    client.deform(large);
    EXPECT_EQ("s" + at.told, system);
  }
  EXPECT_EQ(owned.size(), count);
  EXPECT_EQ(uploads(), 24);
  EXPECT_EQ(client.list_geometries().size(), 24u);
}

TEST_F(SeveralServers, WhatADeadOneHadIsBroughtToAnother) {
  Client client(options());
  const std::string system = prepared(client, 1);
  PlayedServer& dead = owner(system);
  dead.service.stop();
  dead.systems.clear();
  // All at once, and still it is uploaded once.
  for (const auto& server : servers_) server->upload_ms = 50;
  std::vector<std::thread> threads;
  for (int t = 0; t < 8; ++t) {
    threads.emplace_back([&] {
      for (int k = 0; k < 5; ++k) expect_design(client.deform(request(system)));
    });
  }
  for (auto& thread : threads) thread.join();
  EXPECT_EQ(uploads(), 2);
  EXPECT_EQ(owner(system).answered, 40);
  EXPECT_TRUE(registered(client, 1).existed());
}

TEST_F(SeveralServers, WhatWasDeletedIsNotBroughtBack) {
  Client client(options());
  const std::string system = prepared(client, 1);
  PlayedServer& at = owner(system);
  v1::DeleteGeometryRequest removal;
  removal.set_id(system.substr(1));
  client.delete_geometry(removal);
  at.systems.clear();
  expect_error(ErrorCode::not_found, {}, [&] { client.deform(request(system)); });
  EXPECT_EQ(uploads(), 1);
  expect_error(ErrorCode::not_found, {}, [&] { client.delete_geometry(removal); });
}

TEST_F(SeveralServers, OthersAreAskedForWhatIsUnknown) {
  Client first(options());
  Client stranger(options());
  stranger.keep_points("geometry", std::make_shared<const Points>(test::registered_points(5000)));
  const auto asked = [&](const std::string& system) {
    int count = 0;
    for (const auto& server : servers_) count -= server->asked;
    expect_design(stranger.deform(request(system)));
    for (const auto& server : servers_) count += server->asked;
    return count;
  };
  // Where the addresses say so, the first one that is asked knows it.
  int more = 0;
  std::string system;
  for (int k = 0; k < 20; ++k) {
    system = prepared(first, k);
    more += asked(system) > 1;
    EXPECT_EQ(asked(system), 1) << "it is asked first from then on";
  }
  EXPECT_GT(more, 0);
  PlayedServer& at = owner(system);
  EXPECT_EQ(stranger.get_geometry(system.substr(1)).id(), system.substr(1));
  expect_error(ErrorCode::not_found, {"there is none"}, [&] { stranger.deform(request("nowhere")); });
  const std::string address = at.service.address();
  at.service.stop();
  ClientOptions hasty = options();
  hasty.max_attempts = 1;
  Client late(hasty);
  late.keep_points("geometry", std::make_shared<const Points>(test::registered_points(5000)));
  expect_error(ErrorCode::unavailable, {system.c_str() + 1, "do not know it", address.c_str()},
               [&] { late.deform(request(system)); });
  expect_error(ErrorCode::unavailable, {address.c_str()}, [&] { late.list_geometries(); });
}

TEST_F(SeveralServers, OneThatTakesNoWorkIsLeftAloneForAWhile) {
  Client client(options());
  const std::string system = prepared(client, 1);
  std::atomic<int> asked{0};
  owner(system).service.on_deform = [&](grpc::ServerContext&, const v1::DeformRequest&, ScriptedService::Writer&) {
    ++asked;
    return grpc::Status(grpc::StatusCode::UNAVAILABLE, "the server is shutting down");
  };
  const auto start = std::chrono::steady_clock::now();
  for (int k = 0; k < 5; ++k) expect_design(client.deform(request(system)));
  if (std::chrono::steady_clock::now() - start < std::chrono::milliseconds(900)) {
    EXPECT_EQ(asked, 1);
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(1100));
  const int before = asked;
  expect_design(client.deform(request(system)));
  EXPECT_EQ(asked, before + 1) << "then it is asked first again";
}

TEST_F(SeveralServers, WhatCameBackEmptyIsBroughtAgain) {
  Client client(options());
  const std::string system = prepared(client, 1);
  PlayedServer& home = owner(system);
  const auto unavailable = [](grpc::ServerContext&, const v1::DeformRequest&, ScriptedService::Writer&) {
    return grpc::Status(grpc::StatusCode::UNAVAILABLE, "the server is shutting down");
  };
  for (const auto& server : servers_) {
    if (server.get() != &home) server->service.on_deform = unavailable;
  }
  int calls = 0;
  const auto answer = home.service.on_deform;
  home.service.on_deform = [&](grpc::ServerContext& context, const v1::DeformRequest& request, ScriptedService::Writer& writer) {
    if (++calls <= 2) {
      const std::lock_guard lock(home.mutex);
      home.geometries.clear();
      home.systems.clear();
    }
    return calls == 2 ? unavailable(context, request, writer) : answer(context, request, writer);
  };
  expect_design(client.deform(request(system)));
  EXPECT_EQ(home.uploads, 3);
}

TEST_F(SeveralServers, BringingWhatDoesNotHelpEnds) {
  Client client(options());
  const std::string system = prepared(client, 1);
  std::atomic<int> asked{0};
  for (const auto& server : servers_) {
    server->service.on_deform = [&](grpc::ServerContext&, const v1::DeformRequest&, ScriptedService::Writer&) {
      return ++asked < 50 ? unknown_there : grpc::Status::OK;
    };
  }
  expect_error(ErrorCode::not_found, {"there is none"}, [&] { client.deform(request(system)); });
  EXPECT_EQ(asked, 6) << "each before and after";
  EXPECT_EQ(uploads(), 3);
}

TEST_F(SeveralServers, ARefusalIsForTheSameServer) {
  Client client(options());
  const std::string system = prepared(client, 1);
  PlayedServer& at = owner(system);
  std::atomic<int> refusals{0};
  const auto answer = at.service.on_deform;
  at.service.on_deform = [&](grpc::ServerContext& context, const v1::DeformRequest& request, ScriptedService::Writer& writer) {
    if (refusals++ > 0) return answer(context, request, writer);
    context.AddTrailingMetadata("retry-after-ms", "20");
    return grpc::Status(grpc::StatusCode::RESOURCE_EXHAUSTED, "busy");
  };
  expect_design(client.deform(request(system)));
  EXPECT_EQ(refusals, 2);
  EXPECT_EQ(uploads(), 1);
}

TEST_F(SeveralServers, WhenAllAreGoneTheErrorSaysSo) {
  Client client(options());
  const std::string system = prepared(client, 1);
  for (const auto& server : servers_) server->service.stop();
  expect_error(ErrorCode::unavailable, {"127.0.0.1:"}, [&] { client.deform(request(system)); });
  expect_error(ErrorCode::unavailable, {"127.0.0.1:"}, [&] { client.server_info(); });
  auto session = client.open_session();
  auto future = session->submit(request(system));
  expect_error(ErrorCode::unavailable, {"127.0.0.1:"}, [&] { future.get(); });
  session->finish();
}

TEST_F(SeveralServers, ASessionGoesOnWhereAStreamBroke) {
  Client client(options());
  const std::string system = prepared(client, 1);
  const std::string other = prepared(client, 2);
  owner(system).answers_left = 20;
  owner(other).answers_left = 20;
  auto session = client.open_session();
  std::vector<std::future<client::DeformOutcome>> futures;
  for (int k = 0; k < 60; ++k) futures.push_back(session->submit(request(k % 2 == 0 ? system : other)));
  session->finish();
  for (auto& future : futures) expect_design(future.get());
  expect_error(ErrorCode::failed_precondition, {"after finish()"}, [&] { session->submit(request(system)); });
}

TEST_F(SeveralServers, OneAddressMayStandForSeveral) {
  ClientOptions options;
  options.address = servers_[0]->service.address();
  options.patience = std::chrono::milliseconds(0);
  const auto forget = [&] {
    servers_[0]->geometries.clear();
    servers_[0]->systems.clear();
  };
  Client plain(options);
  const std::string system = prepared(plain, 1);
  forget();
  expect_error(ErrorCode::not_found, {}, [&] { plain.deform(request(system)); });
  options.replicas = true;
  Client told(options);
  prepared(told, 1);
  const std::string other = prepared(told, 2);
  auto session = told.open_session();
  for (int k = 0; k < 3; ++k) {
    forget();
    expect_design(told.deform(request(system)));
    forget();
    expect_design(session->submit(request(system)).get());
    expect_design(session->submit(request(other)).get());
  }
  Client also(options);
  also.keep_points("geometry", std::make_shared<const Points>(test::registered_points(5000)));
  forget();
  expect_error(ErrorCode::not_found, {}, [&] { also.deform(request(system)); });
  also.share_copies(told);
  expect_design(also.deform(request(system)));
  session->finish();
  EXPECT_EQ(servers_[0]->streams, 2) << "one for each geometry: a proxy chooses by stream";
  expect_error(ErrorCode::not_found, {}, [&] { told.deform(request("nowhere")); });
}

TEST_F(SeveralServers, AProxyIsAskedAgainWhereItHasNothingToChooseBy) {
  ClientOptions options;
  options.address = servers_[0]->service.address();
  options.patience = std::chrono::milliseconds(0);
  options.replicas = true;
  Client first(options);
  const std::string system = prepared(first, 1);
  int asked = 0;
  const auto answer = servers_[0]->service.on_deform;
  servers_[0]->service.on_deform = [&](grpc::ServerContext& context, const v1::DeformRequest& request,
                                       ScriptedService::Writer& writer) {
    return ++asked < 3 ? unknown_there : answer(context, request, writer);
  };
  Client stranger(options);
  stranger.keep_points("geometry", std::make_shared<const Points>(test::registered_points(5000)));
  expect_design(stranger.deform(request(system)));
  EXPECT_EQ(asked, 3);
}

TEST_F(SeveralServers, WhatOneServerHasDeletedIsNotBroughtBackByAnError) {
  Client client(options());
  const std::string system = prepared(client, 1);
  PlayedServer& at = owner(system);
  for (const auto& server : servers_) {
    if (server.get() == &at) continue;
    server->service.stop();
    break;
  }
  v1::DeleteGeometryRequest removal;
  removal.set_id(system.substr(1));
  expect_error(ErrorCode::unavailable, {"127.0.0.1"}, [&] { client.delete_geometry(removal); });
  at.systems.clear();
  expect_error(ErrorCode::unavailable, {"do not know it"}, [&] { client.deform(request(system)); });
  EXPECT_EQ(uploads(), 1);
}

TEST_F(SeveralServers, ASessionEndsWithWhatIsOpen) {
  Client client(options());
  const std::string system = prepared(client, 1);
  for (const auto& server : servers_) {
    server->service.on_stream = [](grpc::ServerContext& context, ScriptedService::Stream&) {
      while (!context.IsCancelled()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
      return grpc::Status::CANCELLED;
    };
  }
  auto session = client.open_session();
  std::vector<std::future<client::DeformOutcome>> futures;
  for (int k = 0; k < 5; ++k) futures.push_back(session->submit(request(system)));
  session.reset();
  for (auto& future : futures) expect_error(ErrorCode::cancelled, {}, [&] { future.get(); });
}

TEST_F(SeveralServers, OnlyDesignsThatTheSinkDidNotTakeAreAskedForAgain) {
  Client client(options());
  const std::string system = prepared(client, 1);
  PlayedServer& at = owner(system);
  std::atomic<int> first_asked{0};
  at.service.on_deform = [&](grpc::ServerContext&, const v1::DeformRequest& request, ScriptedService::Writer& writer) {
    first_asked = request.designs_size();
    // One design after the other, the first three of them whole.
    std::size_t results = 0;
    ReplyScript script;
    script.designs = static_cast<std::size_t>(request.designs_size());
    script.block_points = 5000;
    for (const auto& reply : test::replies(script)) {
      if (results == 3) break;
      writer.Write(reply, {});
      results += reply.has_result();
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    return grpc::Status(grpc::StatusCode::UNAVAILABLE, "going down");
  };
  std::map<std::size_t, int> taken;
  client.deform(request(system, 8), {}, [&](std::size_t design, client::DeformedDesign&& deformed) {
    ++taken[design];
    EXPECT_EQ(deformed.result.design(), design);
  });
  EXPECT_EQ(first_asked, 8);
  ASSERT_EQ(taken.size(), 8u);
  for (const auto& [design, times] : taken) EXPECT_EQ(times, 1) << design;
}

TEST(UnfinishedDesigns, NobodySeesThePlacesAmongThoseThatWereSent) {
  EXPECT_EQ(client::with_places("designs[1].variables[0]: 7", {4, 6}), "designs[6].variables[0]: 7");
  EXPECT_EQ(client::with_places("designs[2]: no", {4, 6}), "designs[2]: no");
  EXPECT_EQ(client::with_places("designs", {4}), "designs");
  EXPECT_EQ(client::with_places("designs[", {4}), "designs[");
}

TEST(UnfinishedDesigns, ASinkThatThrowsIsTheEnd) {
  v1::DeformRequest request;
  request.add_designs();
  request.add_designs();
  const client::DesignSink sink = [](std::size_t, client::DeformedDesign&&) { throw Error(ErrorCode::unavailable, "no room"); };
  client::UnfinishedDesigns unfinished(request, sink, {});
  const auto send = [](const v1::DeformRequest&, const client::DesignSink& to, const client::DesignMemory&) {
    to(0, {});
    return client::DeformOutcome();
  };
  EXPECT_THROW(unfinished.ask(send), Error);
  EXPECT_EQ(unfinished.repeat(), client::Repeat::no);
}

TEST(UnfinishedDesigns, DesignsThatDependOnOthersStayInTheirRow) {
  v1::DeformRequest request;
  request.add_designs();
  request.add_designs();
  request.set_warm_start(true);
  const client::DesignSink sink = [](std::size_t, client::DeformedDesign&&) {};
  client::UnfinishedDesigns unfinished(request, sink, {});
  EXPECT_EQ(unfinished.repeat(), client::Repeat::yes);
  const auto send = [](const v1::DeformRequest&, const client::DesignSink& to,
                       const client::DesignMemory&) -> client::DeformOutcome {
    to(0, {});
    throw Error(ErrorCode::unavailable, "gone");
  };
  EXPECT_THROW(unfinished.ask(send), Error);
  EXPECT_EQ(unfinished.repeat(), client::Repeat::no);
}

}  // namespace
}  // namespace deform::several_servers_test
