// SPDX-License-Identifier: GPL-3.0-or-later
// Every method of the contract against every role, over the wire; changes of the file of identities.
#include "server/rpc/access.h"

#include <grpcpp/generic/generic_stub.h>

#include <algorithm>
#include <fstream>
#include <map>
#include <set>

#include "core/codec/geometry_id.h"
#include "tests/server/ended_with.h"
#include "tests/server/service_fixture.h"

namespace deform::server::access_test {
namespace {

using grpc::StatusCode;
using support::eventually;

/// The lowest role that may call, by what the method does: seeing is for readers, what computes or adds is for users, what takes
/// away from others of the tenant is for owners, what is about the server itself and whoever uses it is for operators.
const std::map<std::string, std::string> lowest_role = {
    {"RegisterGeometry", "user"}, {"GetGeometry", "reader"},   {"ListGeometries", "reader"},
    {"DeleteGeometry", "owner"},  {"GetPoints", "reader"},     {"Detect", "user"},
    {"Estimate", "user"},         {"Prepare", "user"},         {"GetSystem", "reader"},
    {"ListSystems", "reader"},    {"ReleaseSystem", "owner"},  {"Deform", "user"},
    {"DeformStream", "user"},     {"Evaluate", "user"},        {"JacobianVector", "user"},
    {"VectorJacobian", "user"},   {"EstimateLarge", "user"},   {"PrepareLarge", "user"},
    {"GetSetup", "reader"},       {"GetServerInfo", "reader"}, {"GetBasis", "user"},
    {"ListCalls", "operator"},    {"CancelCall", "operator"},  {"Drain", "operator"},
    {"Undrain", "operator"},      {"Evict", "operator"},       {"ListConnections", "operator"},
    {"ListLimits", "operator"},   {"SetLimit", "operator"},    {"CheckStore", "operator"},
    {"BackupStore", "operator"},
};

constexpr char use_service[] = "deform.v1.DeformService", admin_service[] = "deform.v1.Admin";

std::vector<std::string> methods_of(const char* name) {
  const auto* service = google::protobuf::DescriptorPool::generated_pool()->FindServiceByName(name);
  std::vector<std::string> names;
  for (int i = 0; i < service->method_count(); ++i) names.push_back(service->method(i)->name());
  return names;
}

std::vector<std::string> methods_of_the_contract() {
  std::vector<std::string> names = methods_of(use_service);
  for (auto& name : methods_of(admin_service)) names.push_back(name);
  return names;
}

std::string path_of(const std::string& method) {
  const auto names = methods_of(admin_service);
  const bool admin = std::find(names.begin(), names.end(), method) != names.end();
  return std::string("/") + (admin ? admin_service : use_service) + "/" + method;
}

std::string hash_of(const std::string& token) {
  codec::Sha256 digest;
  digest.add(token.data(), token.size());
  return digest.hex();
}

void write(const std::filesystem::path& path, const std::string& text) {
  std::ofstream(path.string() + ".part") << text;
  std::filesystem::rename(path.string() + ".part", path);
}

class RolesAndMethods : public ServiceFixture {
 protected:
  void start_with(const std::string& text) {
    write(file, text);
    ServiceOptions options;
    options.access.identities = file;
    start(options);
  }

  using Metadata = std::vector<std::pair<std::string, std::string>>;

  /// Calls with one message; its default is no message, with which whoever is let in hears INVALID_ARGUMENT.
  grpc::Status call(const std::string& method, const Metadata& metadata, const std::string& message = "\xff") {
    grpc::GenericStub generic(channel);
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(20));
    for (const auto& [key, value] : metadata) context.AddMetadata(key, value);
    grpc::CompletionQueue queue;
    const auto wait = [&queue] {
      void* tag = nullptr;
      bool ok = false;
      queue.Next(&tag, &ok);
      return ok;
    };
    const auto stream = generic.PrepareCall(&context, path_of(method), &queue);
    stream->StartCall(nullptr);
    wait();
    const grpc::Slice bytes(message);
    stream->WriteLast(grpc::ByteBuffer(&bytes, 1), {}, nullptr);
    wait();
    grpc::ByteBuffer reply;
    do {
      stream->Read(&reply, nullptr);  // the status comes after the last reply was read
    } while (wait());
    grpc::Status status;
    stream->Finish(&status, nullptr);
    wait();
    return status;
  }
  grpc::Status call_as(const std::string& role, const std::string& method) {
    return call(method, {{"authorization", "Bearer " + role + "-token"}});
  }
  static std::string line(const std::string& name, const std::string& role, const std::string& more = "") {
    return name + " " + role + " sha256:" + hash_of(name + "-token") + " " + more + "\n";
  }
  static std::string everybody() {
    return line("reader", "reader") + line("user", "user") + line("owner", "owner") + line("operator", "operator");
  }

  support::TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "identities";
};

TEST_P(RolesAndMethods, EveryMethodIsRefusedWithoutItsRole) {
  start_with(everybody());
  const std::map<std::string, int> ranks = {{"reader", 0}, {"user", 1}, {"owner", 2}, {"operator", 3}};
  for (const std::string& method : methods_of_the_contract()) {
    SCOPED_TRACE(method);
    ASSERT_EQ(lowest_role.count(method), 1u) << "say here, too, who may call it";
    for (const auto& [role, rank] : ranks) {
      const grpc::Status status = call_as(role, method);
      const bool allowed = rank >= ranks.at(lowest_role.at(method));
      EXPECT_EQ(status.error_code(), allowed ? StatusCode::INVALID_ARGUMENT : StatusCode::PERMISSION_DENIED)
          << role << ": " << status.error_message();
      if (!allowed) {
        EXPECT_EQ(status.error_message(),
                  method + " needs the role " + lowest_role.at(method) + ", \"" + role + "\" has " + role);
      }
    }
    EXPECT_THAT(call(method, {}), EndedWith(StatusCode::UNAUTHENTICATED));
    EXPECT_THAT(call(method, {{"authorization", "Bearer stranger"}}), EndedWith(StatusCode::UNAUTHENTICATED));
  }
}

// The status alone does not tell: it is a refusal also where the work has been done before.
TEST_P(RolesAndMethods, AnUploadThatIsRefusedNeverReachesTheEngine) {
  start_with(everybody());
  v1::RegisterGeometryRequest header;
  header.mutable_header()->set_name("sheet");
  const std::string bytes = header.SerializeAsString();
  EXPECT_THAT(call("RegisterGeometry", {{"authorization", "Bearer reader-token"}}, bytes),
              EndedWith(StatusCode::PERMISSION_DENIED));
  EXPECT_EQ(engine.upload_count(), 0u);
  grpc::ClientContext context;
  context.AddMetadata("authorization", "Bearer user-token");
  v1::GeometryInfo info;
  const auto writer = stub->RegisterGeometry(&context, &info);
  writer->WriteLast(header, {});
  EXPECT_TRUE(writer->Finish().ok());
  EXPECT_EQ(engine.upload_count(), 1u);
}

TEST_P(RolesAndMethods, WhatIsNoSingleKnownTokenIsRefused) {
  start_with(everybody());
  EXPECT_THAT(call("GetServerInfo", {{"authorization", "bearer reader-token"}}), EndedWith(StatusCode::INVALID_ARGUMENT));
  for (const std::string value : {"", "Bearer", "Bearer ", "reader-token", "Basic reader-token", "Bearer reader-token x"}) {
    EXPECT_THAT(call("GetServerInfo", {{"authorization", value}}), EndedWith(StatusCode::UNAUTHENTICATED)) << value;
  }
  EXPECT_THAT(call("GetServerInfo", {{"authorization", "Bearer " + std::string(5000, 'x')}}),
              EndedWith(StatusCode::UNAUTHENTICATED));
  const Metadata twice = {{"authorization", "Bearer reader-token"}, {"authorization", "Bearer operator-token"}};
  EXPECT_THAT(call("GetServerInfo", twice), EndedWith(StatusCode::UNAUTHENTICATED));
}

TEST_P(RolesAndMethods, WithoutAFileNobodyIsAsked) {
  start();
  for (const std::string& method : methods_of_the_contract()) {
    EXPECT_THAT(call(method, {}), EndedWith(StatusCode::INVALID_ARGUMENT)) << method;
  }
}

TEST_P(RolesAndMethods, TheQueueGoesByIdentityAndNotByConnection) {
  std::mutex mutex;
  std::vector<std::string> clients;
  engine.on_prepare = [&](const v1::PrepareRequest&, const CallContext& call, auto, auto on_done) {
    {
      const std::lock_guard lock(mutex);
      clients.push_back(call.client);
    }
    on_done({});
  };
  start_with(everybody());
  const auto prepare = [&](const char* token) {
    const auto own = v1::DeformService::NewStub(server->channel());
    grpc::ClientContext context;
    context.AddMetadata("authorization", token);
    v1::PrepareReply reply;
    const auto reader = own->Prepare(&context, {});
    while (reader->Read(&reply)) {
    }
    reader->Finish();
  };
  prepare("Bearer user-token");
  prepare("Bearer user-token");
  prepare("Bearer operator-token");
  ASSERT_EQ(clients.size(), 3u);
  EXPECT_EQ(clients[0], clients[1]);
  EXPECT_NE(clients[0], clients[2]);
}

TEST_P(RolesAndMethods, WithoutIdentitiesTheQueueGoesByHostAndNotByConnection) {
  std::mutex mutex;
  std::vector<std::string> clients;
  engine.on_prepare = [&](const v1::PrepareRequest&, const CallContext& call, auto, auto on_done) {
    {
      const std::lock_guard lock(mutex);
      clients.push_back(call.client);
    }
    on_done({});
  };
  start();
  for (int i = 0; i < 2; ++i) {
    const auto own = v1::DeformService::NewStub(server->channel());
    grpc::ClientContext context;
    v1::PrepareReply reply;
    const auto reader = own->Prepare(&context, {});
    while (reader->Read(&reply)) {
    }
    reader->Finish();
  }
  ASSERT_EQ(clients.size(), 2u);
  EXPECT_EQ(clients[0], clients[1]);
  if (GetParam() == support::Transport::loopback) EXPECT_EQ(clients[0], "ipv4:127.0.0.1");
}

TEST_P(RolesAndMethods, BehindATrustedProxyTheQueueGoesByTheHostsThatItNames) {
  std::mutex mutex;
  std::vector<std::string> clients;
  engine.on_prepare = [&](const v1::PrepareRequest&, const CallContext& call, auto, auto on_done) {
    {
      const std::lock_guard lock(mutex);
      clients.push_back(call.client);
    }
    on_done({});
  };
  ServiceOptions options;
  options.proxies = TrustedProxies("127.0.0.1");
  start(options);
  for (const char* host : {"10.0.0.7", "10.0.0.8"}) {
    grpc::ClientContext context;
    context.AddMetadata("x-forwarded-for", host);
    v1::PrepareReply reply;
    const auto reader = stub->Prepare(&context, {});
    while (reader->Read(&reply)) {
    }
    reader->Finish();
  }
  const bool proxy = GetParam() == support::Transport::loopback;  // in one process there is no address
  EXPECT_EQ(clients, proxy ? (std::vector<std::string>{"ipv4:10.0.0.7", "ipv4:10.0.0.8"}) : std::vector(2, clients.at(0)));
}

TEST_P(RolesAndMethods, AChangeOfTheFileReachesNewCallsAndOpenStreams) {
  start_with(everybody());
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(60));
  context.AddMetadata("authorization", "Bearer user-token");
  const auto stream = stub->DeformStream(&context);
  v1::DeformStreamRequest request;
  request.set_request_id(1);
  request.mutable_request();
  ASSERT_TRUE(stream->Write(request));
  engine.job(0)->push_block(1);
  engine.job(0)->end();
  v1::DeformReply reply;
  EXPECT_TRUE(stream->Read(&reply)) << "the stream works";

  write(file, line("user", "reader") + line("new", "user"));
  const auto start = std::chrono::steady_clock::now();
  EXPECT_TRUE(eventually([&] { return call_as("new", "Deform").error_code() == StatusCode::INVALID_ARGUMENT; }));
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(10));
  EXPECT_THAT(call_as("user", "Deform"), EndedWith(StatusCode::PERMISSION_DENIED));
  EXPECT_THAT(call_as("operator", "GetServerInfo"), EndedWith(StatusCode::UNAUTHENTICATED));
  request.set_request_id(2);
  stream->Write(request);
  while (stream->Read(&reply)) {
  }
  EXPECT_THAT(stream->Finish(), EndedWith(StatusCode::PERMISSION_DENIED)) << "the open stream takes no more requests";
}

// ---- tenants and quotas ----

/// The shortest message with which each method reaches the engine.
std::string message_for(const std::string& method) {
  if (method == "RegisterGeometry") {
    v1::RegisterGeometryRequest request;
    request.mutable_header();
    return request.SerializeAsString();
  }
  if (method == "DeformStream") {
    v1::DeformStreamRequest request;
    request.set_request_id(1);
    request.mutable_request();
    return request.SerializeAsString();
  }
  if (method == "Evaluate") {
    v1::EvaluateRequest request;
    request.mutable_header();
    return request.SerializeAsString();
  }
  if (method == "EstimateLarge" || method == "PrepareLarge") {  // alike on the wire
    v1::PrepareLargeRequest request;
    request.set_setup(std::string("\x0a\x00", 2));  // geometry: ""
    request.mutable_header()->mutable_setup()->set_bytes(request.setup().size());
    return request.SerializeAsString();
  }
  if (method == "VectorJacobian") {
    v1::VectorJacobianRequest request;
    request.mutable_header();
    return request.SerializeAsString();
  }
  return "";
}

TEST_P(RolesAndMethods, EveryMethodReachesTheEngineForTheTenantOfItsCaller) {
  engine.on_job = [](support::FakeJob& job) { job.end(); };
  engine.on_prepare = [](const auto&, const auto&, auto, auto on_done) { on_done({}); };
  engine.on_detect = [](const auto&, const auto&, auto on_done) { on_done({}); };
  engine.on_get_basis = [](const auto&, const auto&, auto on_done) { on_done({}); };
  engine.on_vector_jacobian = [](auto, const auto&, auto on_done) { on_done({}); };
  start_with(line("a", "operator", "tenant=acme") + line("b", "operator", "tenant=b") + line("d", "operator"));
  for (const std::string& method : methods_of(use_service)) {
    for (const auto& [name, tenant] : {std::pair{"a", "acme"}, {"b", "b"}, {"d", "default"}}) {
      const std::size_t before = engine.tenants().size();
      call(method, {{"authorization", std::string("Bearer ") + name + "-token"}}, message_for(method));
      const auto seen = engine.tenants();
      ASSERT_GT(seen.size(), before) << method << " never came to the engine";
      for (std::size_t i = before; i < seen.size(); ++i) EXPECT_EQ(seen[i], tenant) << method;
    }
  }
}

TEST_P(RolesAndMethods, ServerInfoCountsWhatTheTenantHas) {
  start_with(line("a", "reader", "tenant=acme"));
  grpc::ClientContext context;
  context.AddMetadata("authorization", "Bearer a-token");
  v1::ServerInfo info;
  EXPECT_THAT(stub->GetServerInfo(&context, {}, &info), EndedWith(StatusCode::OK));
  EXPECT_EQ(info.geometries(), std::string("acme").size());  // as the fake engine has it
  EXPECT_EQ(info.setups(), 2u);
}

TEST_P(RolesAndMethods, AStreamEndsWhenItsCallerBecomesOfAnotherTenant) {
  start_with(line("a", "user", "tenant=acme"));
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(60));
  context.AddMetadata("authorization", "Bearer a-token");
  const auto stream = stub->DeformStream(&context);
  v1::DeformStreamRequest request;
  request.set_request_id(1);
  request.mutable_request();
  ASSERT_TRUE(stream->Write(request));
  EXPECT_EQ(engine.job(0)->call().tenant, "acme");
  engine.job(0)->push_block(1);
  v1::DeformReply reply;
  EXPECT_TRUE(stream->Read(&reply));
  write(file, line("a", "user", "tenant=b") + line("new", "reader"));
  ASSERT_TRUE(eventually([&] { return call_as("new", "GetServerInfo").error_code() == StatusCode::INVALID_ARGUMENT; }));
  request.set_request_id(2);
  stream->Write(request);
  while (stream->Read(&reply)) {
  }
  EXPECT_THAT(stream->Finish(), EndedWith(StatusCode::UNAUTHENTICATED));
  EXPECT_EQ(engine.job_count(), 1u);
}

TEST_P(RolesAndMethods, RequestsBeyondTheRateOfATenantAreRefusedWithAHint) {
  start_with(line("a", "reader", "tenant=acme") + line("a2", "reader", "tenant=acme") + line("b", "reader", "tenant=b") +
             "tenant:acme requests-per-second=2\n");
  const auto info_as = [&](const std::string& name, std::string& hint) {
    grpc::ClientContext context;
    context.AddMetadata("authorization", "Bearer " + name + "-token");
    v1::ServerInfo info;
    grpc::Status status = stub->GetServerInfo(&context, {}, &info);
    hint = retry_hint(context);
    return status;
  };
  std::string hint;
  int refused = 0;
  for (int i = 0; i < 6; ++i) {
    const grpc::Status status = info_as(i % 2 == 0 ? "a" : "a2", hint);
    if (status.ok()) continue;
    ++refused;
    EXPECT_THAT(status, EndedWith(StatusCode::RESOURCE_EXHAUSTED));
    EXPECT_NE(status.error_message().find("quota requests-per-second of tenant \"acme\""), std::string::npos)
        << status.error_message();
    EXPECT_GT(std::atoi(hint.c_str()), 0);
    EXPECT_LE(std::atoi(hint.c_str()), 500);
  }
  EXPECT_GE(refused, 2);
  for (int i = 0; i < 6; ++i) EXPECT_THAT(info_as("b", hint), EndedWith(StatusCode::OK));
}

// Until it is read an answer takes memory, also that of a call that is a stream of requests.
TEST_P(RolesAndMethods, AnswersCountAmongTheBytesInFlight) {
  std::uint32_t numbers = 0;
  engine.on_estimate = [&](const auto&, const auto&, auto on_done) {
    v1::EstimateReply reply;
    for (std::uint32_t i = 0; i < numbers; ++i) reply.add_centre_steps(i % 100);
    Engine::Outcome<v1::EstimateReply> outcome;
    outcome.value = std::move(reply);
    on_done(std::move(outcome));
  };
  start_with(line("a", "user", "tenant=acme") + "tenant:acme bytes-in-flight=256KiB\n");
  const auto answered = [&](std::uint32_t count) {
    numbers = count;
    return call("EstimateLarge", {{"authorization", "Bearer a-token"}}, message_for("EstimateLarge"));
  };
  EXPECT_THAT(answered(100'000), EndedWith(StatusCode::OK));
  const grpc::Status status = answered(400'000);
  EXPECT_THAT(status, EndedWith(StatusCode::RESOURCE_EXHAUSTED));
  EXPECT_NE(status.error_message().find("quota bytes-in-flight"), std::string::npos) << status.error_message();
}

TEST_P(RolesAndMethods, RequestsOfAStreamCountAndAChangedQuotaReachesIt) {
  engine.on_job = [](support::FakeJob& job) { job.end(); };
  start_with(line("a", "user", "tenant=acme") + "tenant:acme calls=7\n");
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(60));
  context.AddMetadata("authorization", "Bearer a-token");
  const auto stream = stub->DeformStream(&context);
  v1::DeformStreamRequest request;
  request.set_request_id(1);
  request.mutable_request();
  ASSERT_TRUE(stream->Write(request));
  EXPECT_EQ(engine.job(0)->call().quota.calls, 7u);
  write(file, line("a", "user", "tenant=acme") + line("new", "reader") +
                  "tenant:acme calls=8 bytes-in-flight=3GiB requests-per-second=1\n");
  ASSERT_TRUE(eventually([&] { return call_as("new", "GetServerInfo").error_code() == StatusCode::INVALID_ARGUMENT; }));
  int refused = 0;
  v1::DeformReply reply;
  for (std::uint64_t id = 2; id < 12; ++id) {
    request.set_request_id(id);
    ASSERT_TRUE(stream->Write(request));
  }
  stream->WritesDone();
  while (stream->Read(&reply)) refused += reply.has_error() && reply.error().retry_after_ms() > 0;
  EXPECT_THAT(stream->Finish(), EndedWith(StatusCode::OK)) << "the stream goes on";
  EXPECT_GE(refused, 5);
  EXPECT_EQ(engine.job(1)->call().quota.calls, 8u);
  // What the requests of a tenant hold is counted together, with what is in force for each.
  ASSERT_NE(engine.job(0)->call().in_flight, nullptr);
  EXPECT_EQ(engine.job(0)->call().in_flight, engine.job(1)->call().in_flight);
  EXPECT_EQ(engine.job(0)->call().share().limit, 0u);
  EXPECT_EQ(engine.job(1)->call().share().limit, std::size_t{3} << 30);
}

TEST_P(RolesAndMethods, ABrokenFileLeavesTheOneBeforeInForce) {
  start_with(everybody());
  write(file, "nonsense\n");
  std::this_thread::sleep_for(std::chrono::milliseconds(1500));
  EXPECT_THAT(call_as("user", "Deform"), EndedWith(StatusCode::INVALID_ARGUMENT));
  std::filesystem::remove(file);
  std::this_thread::sleep_for(std::chrono::milliseconds(1500));
  EXPECT_THAT(call_as("user", "Deform"), EndedWith(StatusCode::INVALID_ARGUMENT));
  EXPECT_THAT(call("Deform", {}), EndedWith(StatusCode::UNAUTHENTICATED));
}

DEFORM_BOTH_TRANSPORTS(RolesAndMethods);

TEST(IdentitiesAtStart, AMissingOrWrongFileIsRefused) {
  const support::TemporaryFolder folder;
  ServerOptions options;
  options.address = "";
  options.service.access.identities = folder.path() / "none";
  EXPECT_THROW(start_server(options, std::make_unique<support::FakeEngine>()), Error);
  write(options.service.access.identities, "alice");
  EXPECT_THROW(start_server(options, std::make_unique<support::FakeEngine>()), Error);
  write(options.service.access.identities, "");
  EXPECT_NO_THROW(start_server(options, std::make_unique<support::FakeEngine>()));
}

}  // namespace
}  // namespace deform::server::access_test
