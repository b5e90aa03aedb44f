// SPDX-License-Identifier: GPL-3.0-or-later
// The engine for several tenants: each hears of its own and of nothing else, and takes no more than its quota.
#include <gmock/gmock-matchers.h>

#include <filesystem>

#include "core/codec/block.h"
#include "proto/convert/base/block.h"
#include "server/store/tenant.h"
#include "tests/server/engine_fixture.h"

namespace deform::server::tenants_test {
namespace {

class Tenants : public EngineFixture {
 protected:
  static CallContext as(const std::string& tenant, const Quota& quota = {}) {
    CallContext call;
    call.client = "identity of " + tenant;
    call.tenant = tenant;
    call.quota = quota;
    return call;
  }
  std::unique_ptr<GeometryUpload> begin(const CallContext& call, const std::string& id, const std::string& name = "sheet") {
    v1::GeometryHeader header = header_of(mesh, name);
    header.set_id(id);
    return engine->begin_upload(header, call);
  }
  v1::GeometryInfo register_as(const CallContext& call, const std::string& name = "sheet") {
    const auto upload = begin(call, "", name);
    for (const auto& message : upload_messages(mesh)) upload->add(message);
    return upload->finish();
  }
  /// How a call ends: its code and message.
  template <typename Action>
  static std::string outcome(const Action& action) {
    try {
      action();
    } catch (const Error& error) {
      return std::string(to_string(error.code())) + ": " + error.what();
    }
    return "ok";
  }

  const Mesh mesh = sheet_mesh(12, 10);
};

// One row for every call that takes an id: what it says of another tenant's is to the letter what it says of nobody's.
TEST_F(Tenants, EveryCallAnswersForAnothersIdAsForAnUnknownOne) {
  const std::string geometry = register_as(as("acme"), "secret.obj").id();
  const std::string system = prepare(sheet_setup(geometry), as("acme")).id();
  const CallContext stranger = as("b");
  using Call = std::function<void(const std::string& id)>;
  const auto upload = [&](const std::string& id) {
    const auto begun = begin(stranger, id);
    EXPECT_FALSE(begun->already_stored()) << "an upload must not be cut short";
    begun->finish();
  };
  v1::DeleteGeometryRequest remove;
  const std::vector<std::pair<const char*, Call>> by_geometry = {
      {"get_geometry", [&](const auto& id) { engine->get_geometry(id, stranger); }},
      {"get_points", [&](const auto& id) { engine->get_points(id, stranger); }},
      {"delete_geometry",
       [&](const auto& id) {
         v1::DeleteGeometryRequest request;
         request.set_id(id);
         request.set_with_setups(true);
         engine->delete_geometry(request, stranger);
       }},
      {"detect",
       [&](const auto& id) {
         v1::DetectRequest request;
         request.set_geometry_id(id);
         Waiter<Engine::DetectReplies> waiter;
         engine->detect(request, stranger, waiter.callback());
         waiter.value();
       }},
      {"estimate",
       [&](const auto& id) {
         v1::EstimateRequest request;
         *request.mutable_setup() = sheet_setup(id);
         EngineFixture::estimate(request, stranger);
       }},
      {"estimate with problems",
       [&](const auto& id) {
         v1::EstimateRequest request;
         *request.mutable_setup() = sheet_setup(id);
         request.set_list_problems(true);
         EngineFixture::estimate(request, stranger);
       }},
      {"prepare", [&](const auto& id) { prepare(sheet_setup(id), stranger); }},
      {"list_systems",
       [&](const auto& id) {
         v1::ListSystemsRequest request;
         request.set_geometry_id(id);
         engine->list_systems(request, stranger);
       }},
      {"upload", upload},
  };
  const std::vector<std::pair<const char*, Call>> by_system = {
      {"get_system", [&](const auto& id) { engine->get_system(id, stranger); }},
      {"release_system",
       [&](const auto& id) {
         v1::ReleaseSystemRequest request;
         request.set_id(id);
         request.set_forget(true);
         engine->release_system(request, stranger);
       }},
      {"deform",
       [&](const auto& id) {
         deform(request_for(id, {{0.1, 0.1}}), stranger);
       }},
      {"evaluate",
       [&](const auto& id) {
         v1::EvaluateHeader header;
         header.set_system_id(id);
         header.mutable_design();
         engine->evaluate(header, stranger, [] {});
       }},
      {"jacobian_vector",
       [&](const auto& id) {
         v1::JacobianVectorRequest request;
         request.set_system_id(id);
         engine->jacobian_vector(request, stranger, [] {});
       }},
      {"vector_jacobian",
       [&](const auto& id) {
         v1::VectorJacobianHeader header;
         header.set_system_id(id);
         Waiter<v1::VectorJacobianReply> waiter;
         engine->vector_jacobian(header, Points(mesh.point_count()), stranger, waiter.callback());
         waiter.value();
       }},
      {"get_basis",
       [&](const auto& id) {
         v1::GetBasisRequest request;
         request.set_system_id(id);
         Waiter<std::shared_ptr<BasisRecords>> waiter;
         engine->get_basis(request, stranger, waiter.callback());
         waiter.value();
       }},
  };
  const auto check = [&](const auto& calls, const std::string& theirs) {
    std::string nobodys = theirs;
    nobodys[3] = nobodys[3] == 'a' ? 'b' : 'a';
    for (const auto& [name, call] : calls) {
      std::string expected = outcome([&, &call = call] { call(nobodys); });
      EXPECT_NE(expected, "ok") << name;
      for (std::size_t at = 0; (at = expected.find(nobodys, at)) != std::string::npos;)
        expected.replace(at, theirs.size(), theirs);
      EXPECT_EQ(outcome([&, &call = call] { call(theirs); }), expected) << name;
    }
  };
  check(by_geometry, geometry);
  check(by_system, system);
  EXPECT_EQ(engine->list_geometries({}, stranger).geometries_size(), 0);
  EXPECT_EQ(engine->list_systems({}, stranger).systems_size(), 0);
  EXPECT_EQ(engine->stored("b").geometries, 0u);
  EXPECT_EQ(engine->get_system(system, as("acme")).resident(), true) << "nothing of it was touched";
}

TEST_F(Tenants, AnUploadOfWhatAnotherHasTakesItsFullWay) {
  const std::string id = register_as(as("acme"), "theirs.obj").id();
  const auto upload = begin(as("b"), id, "mine.obj");
  EXPECT_FALSE(upload->already_stored());
  for (const auto& message : upload_messages(mesh)) upload->add(message);
  const v1::GeometryInfo info = upload->finish();
  EXPECT_FALSE(info.existed());
  EXPECT_EQ(info.name(), "mine.obj");
  EXPECT_EQ(engine->get_geometry(id, as("acme")).name(), "theirs.obj");
  EXPECT_TRUE(begin(as("b"), id)->already_stored());
}

// What is in memory is found by its owner alone: the answer to another must take as long as if nobody had it.
TEST_F(Tenants, ASystemInMemoryIsNoneForOthers) {
  const std::string geometry = register_as(as("acme")).id();
  const std::string system = prepare(sheet_setup(geometry), as("acme")).id();
  register_as(as("b"));
  v1::EstimateRequest request;
  *request.mutable_setup() = sheet_setup(geometry);
  EXPECT_TRUE(EngineFixture::estimate(request, as("acme")).resident());
  EXPECT_FALSE(EngineFixture::estimate(request, as("b")).resident());
  EXPECT_EQ(EngineFixture::estimate(request, as("b")).system_id(), system);
  const std::uint64_t misses = engine->info().cache_misses();
  stages.clear();
  EXPECT_EQ(prepare(sheet_setup(geometry), as("b")).id(), system);
  EXPECT_EQ(engine->info().cache_misses(), misses + 1) << "it was prepared, not found";
  EXPECT_THAT(stages, testing::Contains("select"));
  EXPECT_EQ(engine->info().systems_resident(), 2u);
  v1::ReleaseSystemRequest release;
  release.set_id(system);
  engine->release_system(release, as("b"));
  EXPECT_TRUE(engine->get_system(system, as("acme")).resident());
  EXPECT_FALSE(engine->get_system(system, as("b")).resident());
}

TEST_F(Tenants, DeletingLeavesToOthersWhatTheyHave) {
  const std::string geometry = register_as(as("acme")).id();
  register_as(as("b"));
  const std::string system = prepare(sheet_setup(geometry), as("acme")).id();
  prepare(sheet_setup(geometry), as("b"));
  v1::DeleteGeometryRequest remove;
  remove.set_id(geometry);
  remove.set_with_setups(true);
  EXPECT_EQ(engine->delete_geometry(remove, as("acme")).setups_deleted(), 1u);
  EXPECT_EQ(outcome([&] { engine->get_points(geometry, as("acme")); }), "not_found: geometry " + geometry + ": unknown id");
  EXPECT_EQ(*engine->get_points(geometry, as("b")), mesh.points);
  EXPECT_EQ(deform(request_for(system, {{0.1, 0.1}}), as("b")).points.size(), 1u);
  reopen();
  EXPECT_EQ(*engine->get_points(geometry, as("b")), mesh.points);
  EXPECT_EQ(deform(request_for(system, {{0.1, 0.1}}), as("b")).points.size(), 1u) << "prepared again after the restart";
  EXPECT_NE(outcome([&] { deform(request_for(system, {{0.1, 0.1}}), as("acme")); }), "ok");
}

TEST_F(Tenants, AnUploadBeyondTheQuotaIsRefusedBeforeItsBytes) {
  Quota one;
  one.geometries = 1;
  register_as(as("acme", one));
  v1::GeometryHeader other = header_of(sheet_mesh(5, 5), "other");
  EXPECT_THAT(outcome([&] { engine->begin_upload(other, as("acme", one)); }),
              testing::HasSubstr("quota geometries of tenant \"acme\": 1 are registered, the limit is 1"));
  EXPECT_EQ(outcome([&] { engine->begin_upload(other, as("b", one)); }), "ok");
  Quota small;
  small.stored_bytes = 1000;
  EXPECT_THAT(outcome([&] { engine->begin_upload(header_of(mesh), as("c", small)); }),
              testing::HasSubstr("quota stored-bytes of tenant \"c\""));
}

TEST_F(Tenants, WhatWasLostIsRegisteredAgainAtTheQuota) {
  Quota one;
  one.geometries = 1;
  const std::string geometry = register_as(as("acme", one)).id();
  const auto file = directory.path() / "data" / "geometries" / key_of({"acme", geometry});
  ASSERT_TRUE(std::filesystem::remove(file));
  const auto upload = begin(as("acme", one), geometry);
  EXPECT_FALSE(upload->already_stored());
  for (const auto& message : upload_messages(mesh)) upload->add(message);
  upload->finish();
  EXPECT_TRUE(std::filesystem::exists(file));
  EXPECT_EQ(engine->stored("acme").geometries, 1u);
}

TEST_F(Tenants, APreparationBeyondTheQuotaIsRefusedBeforeTheWork) {
  const std::string geometry = register_as(as("acme")).id();
  Quota full;
  full.stored_bytes = engine->stored("acme").bytes;
  stages.clear();
  EXPECT_THAT(outcome([&] { prepare(sheet_setup(geometry), as("acme", full)); }), testing::HasSubstr("quota stored-bytes"));
  EXPECT_TRUE(stages.empty());
}

TEST_F(Tenants, PreparationsBeyondTheQuotaAreRefusedAndLeaveNothing) {
  const std::string geometry = register_as(as("acme")).id();
  Quota quota;
  quota.preparations = 1;
  quota.calls = 2;
  const std::string known = prepare(sheet_setup(geometry), as("acme", quota)).id();
  v1::ReleaseSystemRequest release;
  release.set_id(known);
  engine->release_system(release, as("acme"));
  const auto setup_of = [&](v1::Kernel kernel) {
    v1::Setup setup = sheet_setup(geometry);
    setup.mutable_method()->mutable_rbf()->set_kernel(kernel);
    return setup;
  };
  Gate gate;
  Waiter<v1::SystemInfo> first;
  v1::PrepareRequest request;
  *request.mutable_setup() = setup_of(v1::BIHARMONIC);
  const auto wait = [&](const v1::Progress& progress) {
    if (progress.stage() != "queue") gate.pass();
  };
  engine->prepare(request, as("acme", quota), wait, first.callback());
  ASSERT_TRUE(eventually([&] { return gate.waiting() == 1; }));
  const auto deform_known = [&] { engine->deform(request_for(known, {{0.1, 0.1}}), 0, as("acme", quota), [] {})->cancel(); };
  for (int i = 0; i < 4; ++i) {  // what was refused does not count as a call
    EXPECT_THAT(outcome([&] { prepare(setup_of(v1::WENDLAND_C2), as("acme", quota)); }),
                testing::HasSubstr("quota preparations of tenant \"acme\": 1 "));
    EXPECT_THAT(outcome(deform_known), testing::HasSubstr("quota preparations"));
  }
  gate.open();
  EXPECT_EQ(outcome([&] { first.value(); }), "ok");
  EXPECT_EQ(outcome(deform_known), "ok");
}

// Answers that nobody takes hold memory, by which the next request is refused; and a stream reads on by as much as there is.
TEST_F(Tenants, BytesInFlightBeyondTheQuotaAreRefused) {
  const std::string geometry = register_as(as("acme")).id();
  const std::string system = prepare(sheet_setup(geometry), as("acme")).id();
  TenantMeters meters;
  const auto within = [&](std::uint64_t bytes) {
    CallContext call = as("acme");
    call.in_flight = meters.of("acme");
    call.quota.bytes_in_flight = bytes;
    return call;
  };
  v1::EvaluateHeader header;
  header.set_system_id(system);
  header.mutable_output()->set_encoding(v1::RAW_F64);
  for (const double x : {0.2, 0.3}) header.mutable_design()->add_variables(x);
  v1::EvaluateReply reply;
  Doorbell bell;
  const auto next = [&](EvaluateJob& job) {
    while (job.poll(reply) == DeformJob::Poll::pending) bell.wait();
  };
  const auto block = [&](std::uint32_t number) {
    const Points points(1000, Vec3{0.5, 0.5, number * 0.001});
    v1::Block message;
    message.set_block(number);
    message.set_first(number * points.size());
    convert::block_to_proto(codec::encode(points, points, {codec::Encoding::raw_f64, 0}), message);
    return message;
  };
  constexpr std::uint64_t mib = 1 << 20;
  const auto job = engine->evaluate(header, within(16 * mib), bell.ring());
  next(*job);
  const std::size_t of_one = meters.of("acme")->in_use();
  ASSERT_LT(of_one, 8 * mib);
  ASSERT_GT(of_one, 4 * mib);
  ASSERT_TRUE(job->has_room());
  job->add(block(0));
  ASSERT_TRUE(job->has_room());
  job->add(block(1));
  EXPECT_FALSE(job->has_room()) << "there is no room for a third";
  next(*job);
  EXPECT_EQ(reply.block().block(), 0u);
  EXPECT_TRUE(job->has_room());
  next(*job);
  EXPECT_EQ(meters.of("acme")->in_use(), of_one) << "all is answered";
  const auto second = engine->evaluate(header, within(of_one + mib), bell.ring());
  for (;;) {
    const auto poll = second->poll(reply);
    if (poll == DeformJob::Poll::done) break;
    ASSERT_EQ(poll, DeformJob::Poll::pending);
    bell.wait();
  }
  ASSERT_TRUE(second->error());
  EXPECT_EQ(second->error()->code(), ErrorCode::out_of_budget);
  EXPECT_THAT(second->error()->what(), testing::HasSubstr("quota bytes-in-flight of tenant \"acme\""));
  EXPECT_GT(second->error()->retry_after_ms(), 0u);
  job->cancel();
  EXPECT_TRUE(eventually([&] { return meters.of("acme")->in_use() == 0; }));
  // Uploads, too.
  const Mesh large = sheet_mesh(300, 300);
  const auto upload = engine->begin_upload(header_of(large, "large"), within(mib));
  EXPECT_THAT(outcome([&] {
                for (const auto& message : upload_messages(large)) upload->add(message);
              }),
              testing::HasSubstr("quota bytes-in-flight"));
}

TEST_F(Tenants, CallsBeyondTheQuotaAreRefusedWithAHintAndOthersAreNot) {
  const std::string geometry = register_as(as("acme")).id();
  register_as(as("b"));
  const std::string system = prepare(sheet_setup(geometry), as("acme")).id();
  prepare(sheet_setup(geometry), as("b"));
  Quota two;
  two.calls = 2;
  const auto begin_deform = [&](const CallContext& call) {
    return engine->deform(request_for(system, {{0.1, 0.1}}), 0, call, [] {});
  };
  auto first = begin_deform(as("acme", two)), second = begin_deform(as("acme", two));  // whose answers nobody takes
  try {
    begin_deform(as("acme", two));
    FAIL() << "a third call was let in";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::out_of_budget);
    EXPECT_GT(error.retry_after_ms(), 0u);
    EXPECT_EQ(error.refusal(), Refusal::quota);
    EXPECT_THAT(error.what(), testing::HasSubstr("quota calls of tenant \"acme\": 2 wait or run, the limit is 2"));
  }
  v1::EstimateRequest request;
  *request.mutable_setup() = sheet_setup(geometry);
  EXPECT_THAT(outcome([&] { EngineFixture::estimate(request, as("acme", two)); }), testing::HasSubstr("quota calls of tenant"));
  EXPECT_EQ(outcome([&] { EngineFixture::estimate(request, as("b", two)); }), "ok");
  EXPECT_EQ(outcome([&] { begin_deform(as("b", two))->cancel(); }), "ok");
  first->cancel();
  EXPECT_TRUE(eventually([&] { return outcome([&] { begin_deform(as("acme", two))->cancel(); }) == "ok"; }));
  second->cancel();
}

}  // namespace
}  // namespace deform::server::tenants_test
