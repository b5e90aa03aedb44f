// SPDX-License-Identifier: GPL-3.0-or-later
// Calls as the operator sees them, and ends them; systems evicted; the store checked beside the work.
#include "server/engine/open_calls.h"

#include <gmock/gmock-matchers.h>

#include <filesystem>
#include <fstream>

#include "tests/server/engine_fixture.h"

namespace deform::server::open_calls_test {
namespace {

using testing::HasSubstr;

constexpr std::size_t all = 1000;
const Error by_operator(ErrorCode::cancelled, "the operator says so");

OpenCall::About about(const std::string& method, const std::string& tenant = default_tenant) {
  OpenCall::About out;
  out.method = method;
  out.tenant = tenant;
  return out;
}

std::vector<std::string> methods(const v1::ListCallsReply& reply) {
  std::vector<std::string> out;
  for (const auto& call : reply.calls()) out.push_back(call.method());
  return out;
}

TEST(OpenCalls, AreListedInTheirOrderAsLongAsTheyLive) {
  OpenCalls calls;
  const auto first = calls.open(about("Prepare"), {});
  auto second = calls.open(about("Deform", "acme"), {});
  const auto third = calls.open(about("GetPoints"), {});
  EXPECT_THAT(methods(calls.list({}, 0, all)), testing::ElementsAre("Prepare", "Deform", "GetPoints"));
  EXPECT_THAT(methods(calls.list({}, first->id(), all)), testing::ElementsAre("Deform", "GetPoints")) << "without one's own";
  EXPECT_THAT(methods(calls.list("acme", 0, all)), testing::ElementsAre("Deform"));
  const auto two = calls.list({}, 0, 2);
  EXPECT_EQ(two.calls_size(), 2);
  EXPECT_EQ(two.left_out(), 1u);
  const std::uint64_t id = second->id();
  second.reset();
  EXPECT_THAT(methods(calls.list({}, 0, all)), testing::ElementsAre("Prepare", "GetPoints"));
  EXPECT_GT(calls.open(about("Deform"), {})->id(), id) << "no id is used twice";
}

TEST(OpenCalls, AreListedNoLongerOnceTheyAreAnswered) {
  OpenCalls calls;
  std::stop_source stop;
  const auto answered = calls.open(about("ListCalls"), stop);
  const auto other = calls.open(about("Prepare"), {});
  const auto request = answered->open_request(1, {});
  answered->answered();
  answered->answered();
  EXPECT_EQ(calls.size(), 2u);
  const v1::ListCallsReply listed = calls.list({}, 0, all);
  ASSERT_EQ(listed.calls_size(), 2);
  EXPECT_EQ(listed.calls(0).id(), other->id());
  EXPECT_EQ(listed.calls(1).id(), request->id()) << "of a stream, with an end of its own";
  EXPECT_THROW(calls.end(answered->id(), std::nullopt, Error(ErrorCode::cancelled, "late")), Error);
  EXPECT_FALSE(stop.stop_requested());
}

TEST(OpenCalls, TellWhatTheyDoAndHold) {
  OpenCalls calls;
  const auto first = calls.open(about("Deform"), {}), second = calls.open(about("Deform", "acme"), {});
  for (const auto& call : {first, second}) call->enter(v1::CALL_WAITING);
  second->set_cost(5000);
  second->set_subject("geometry", "");
  second->set_subject("", std::string(500, 's'));
  second->set_request_bytes(10);
  second->set_result_bytes(32);
  const auto request = second->open_request(7, {});
  const auto reply = calls.list("acme", 0, all);
  ASSERT_EQ(reply.calls_size(), 2);
  EXPECT_EQ(reply.calls(0).state(), v1::CALL_WAITING);
  EXPECT_EQ(reply.calls(0).ahead(), 1u) << "those of others wait, too";
  EXPECT_EQ(reply.calls(0).cost(), 5000);
  EXPECT_EQ(reply.calls(0).geometry(), "geometry");
  EXPECT_EQ(reply.calls(0).system(), std::string(64, 's'));
  EXPECT_EQ(reply.calls(0).bytes_held(), 42u);
  EXPECT_EQ(reply.calls(1).stream(), second->id());
  EXPECT_EQ(reply.calls(1).stream_request(), 7u);
  EXPECT_EQ(reply.calls(1).state(), v1::CALL_OPEN);
}

TEST(OpenCalls, EndOnceAndForGood) {
  OpenCalls calls;
  std::stop_source stop;
  const auto call = calls.open(about("Prepare", "acme"), stop);
  int told = 0;
  call->on_end([&] { ++told; });
  EXPECT_THROW(calls.end(call->id() + 1, {}, by_operator), Error);
  EXPECT_THROW(calls.end(call->id(), "b", by_operator), Error) << "what another tenant has does not exist";
  EXPECT_FALSE(call->ended() || stop.stop_requested());
  EXPECT_EQ(calls.end(call->id(), "acme", by_operator).method(), "Prepare");
  EXPECT_TRUE(stop.stop_requested());
  EXPECT_STREQ(call->ended()->what(), "the operator says so");
  EXPECT_FALSE(call->end(Error(ErrorCode::cancelled, "again")));
  EXPECT_STREQ(call->ended()->what(), "the operator says so");
  EXPECT_EQ(told, 1);
  call->on_end([&] { told += 10; });
  EXPECT_EQ(told, 11) << "who comes later is told at once";
}

TEST(OpenCalls, MayOutliveTheirList) {
  auto calls = std::make_unique<OpenCalls>();
  const auto call = calls->open(about("Prepare"), {});
  calls.reset();
  EXPECT_TRUE(call->end(by_operator));
}

class OperatedEngine : public EngineFixture {
 protected:
  CallContext listed(const std::string& method) {
    std::stop_source stop;
    CallContext call;
    call.stop = stop.get_token();
    call.open = calls.open(about(method), stop);
    return call;
  }
  v1::CallInfo only() {
    const auto reply = calls.list({}, 0, all);
    return reply.calls_size() == 1 ? reply.calls(0) : v1::CallInfo();
  }
  /// The cost of the only one, once those before it are gone.
  double cost() {
    EXPECT_TRUE(eventually([&] { return calls.size() == 1; }));
    return only().cost();
  }
  OpenCalls calls;
};

TEST_F(OperatedEngine, EndsAPreparationAndGivesItsMemoryBack) {
  v1::PrepareRequest request;
  *request.mutable_setup() = sheet_setup(register_mesh(sheet_mesh(300, 300)).id());
  request.mutable_setup()->mutable_method()->mutable_rbf()->set_reduction(v1::REDUCTION_RINGS);
  request.mutable_setup()->mutable_method()->mutable_rbf()->set_reduction_rings(60);
  const std::uint64_t before = engine->info().memory_in_use();
  Waiter<v1::SystemInfo> waiter;
  engine->prepare(request, listed("Prepare"), {}, waiter.callback());
  EXPECT_EQ(only().state(), v1::CALL_PREPARING);
  EXPECT_EQ(only().system().size(), 64u);
  ASSERT_TRUE(eventually([&] { return engine->info().memory_in_use() > before + (1u << 20); })) << "it is prepared";
  calls.end(only().id(), {}, by_operator);
  try {
    waiter.value();
    FAIL() << "it was prepared all the same";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::cancelled);
    EXPECT_STREQ(error.what(), "the operator says so");
  }
  EXPECT_TRUE(eventually([&] { return engine->info().memory_in_use() <= before; }));
  EXPECT_TRUE(eventually([&] { return calls.size() == 0; }));
  EXPECT_EQ(engine->info().systems_resident(), 0u);
}

TEST_F(OperatedEngine, EndsADeformationThatWaitsForItsReader) {
  options.block_points = 256;
  reopen();
  const std::string system = prepare(sheet_setup(register_mesh(sheet_mesh(100, 100)).id())).id();
  v1::DeformRequest request = request_for(system, std::vector<std::vector<double>>(100, {0.2, 0.1}));
  const auto job = engine->deform(request, 0, listed("Deform"), [] {});
  ASSERT_TRUE(eventually([&] { return only().state() == v1::CALL_RUNNING && only().bytes_held() > 0; }));
  EXPECT_GT(only().cost(), 100 * 100 * 100);
  EXPECT_EQ(only().system(), system);
  calls.end(only().id(), {}, by_operator);
  ASSERT_TRUE(eventually([&] { return job->error().has_value(); }));
  EXPECT_STREQ(job->error()->what(), "the operator says so");
}

TEST_F(OperatedEngine, DerivativesCountOncePerCotangent) {
  const std::string system = prepare(sheet_setup(register_mesh(sheet_mesh(40, 30)).id())).id();
  const auto cost_of = [&](std::uint32_t cotangents) {
    v1::VectorJacobianHeader header;
    header.set_system_id(system);
    header.set_cotangents(cotangents);
    const CallContext call = listed("VectorJacobian");
    Waiter<v1::VectorJacobianReply> waiter;
    engine->vector_jacobian(header, Points(std::max(1u, cotangents) * 40 * 30), call, waiter.callback());
    waiter.value();
    return cost();
  };
  EXPECT_EQ(cost_of(0), 40 * 30 + Scheduler::least_cost);
  EXPECT_EQ(cost_of(70), 70 * (40 * 30 + Scheduler::least_cost));
}

TEST_F(OperatedEngine, DesignsWithConstraintsCountForTheTimeThatTheyTake) {
  v1::Setup setup = sheet_setup(register_mesh(sheet_mesh(40, 30)).id());
  setup.mutable_method()->mutable_shell();
  auto& constraint = *setup.add_constraints();
  constraint.set_name("flat");
  constraint.mutable_planar();
  auto& box = *constraint.add_regions()->mutable_box();
  for (const double x : {0.4, 0.2, -1.0}) box.add_min(x);
  for (const double x : {0.6, 0.8, 1.0}) box.add_max(x);
  const v1::SystemInfo prepared = prepare(setup);
  ASSERT_GT(prepared.design_seconds(), 1e-4);
  const auto costs = [&] {
    const CallContext call = listed("Deform");
    deform(request_for(prepared.id(), {{0.01, 0.01}, {0.02, 0.01}}), call);
    EXPECT_NEAR(cost(), 2 * (40 * 30 + Scheduler::least_cost + 1e7 * prepared.design_seconds()), 1e-3);
  };
  costs();
  v1::ReleaseSystemRequest release;
  release.set_id(prepared.id());
  engine->release_system(release, {});
  costs();
  // Preparing what is there is no work.
  const CallContext call = listed("Prepare");
  prepare(setup, call);
  EXPECT_EQ(cost(), Scheduler::least_cost);
}

TEST_F(OperatedEngine, EvictsOneSystemOrAllOfATenantOrAll) {
  const auto prepare_as = [&](const std::string& tenant, double salt) {
    CallContext call;
    call.tenant = tenant;
    const Mesh mesh = sheet_mesh(20, 20, salt);
    const auto upload = engine->begin_upload(header_of(mesh, "sheet"), call);
    for (const auto& message : upload_messages(mesh)) upload->add(message);
    return prepare(sheet_setup(upload->finish().id()), call).id();
  };
  const std::string first = prepare_as(default_tenant, 1), second = prepare_as(default_tenant, 2);
  prepare_as("acme", 1);
  EXPECT_THROW(engine->evict(first.substr(0, 7), {}), Error) << "too short";
  EXPECT_THROW(engine->evict(second, "acme"), Error) << "not its own";
  EXPECT_THROW(engine->evict(std::string(64, '0'), {}), Error);
  EXPECT_EQ(engine->info().systems_resident(), 3u);
  const auto one = engine->evict(second.substr(0, 12), {});
  EXPECT_EQ(one.systems, 1u);
  EXPECT_GT(one.bytes, 1000u);
  EXPECT_EQ(engine->evict("", "acme").systems, 1u);
  EXPECT_EQ(engine->info().systems_resident(), 1u);
  EXPECT_EQ(engine->evict("", {}).systems, 1u);
  EXPECT_EQ(engine->info().cache_bytes(), 0u);
  EXPECT_TRUE(eventually([&] {
    engine->evict("", {});  // a mesh that a call has only just let go of stays for the next use
    return engine->info().memory_in_use() == 0;
  }));
  deform(request_for(first, {{0.2, 0.1}}));
  EXPECT_EQ(engine->info().systems_resident(), 1u) << "the next use prepares it again";
}

TEST_F(OperatedEngine, WhatIsInUseIsGivenBackWhenTheCallsWithItEnd) {
  const std::string system = prepare(sheet_setup(register_mesh(sheet_mesh(100, 100)).id())).id();
  auto job = engine->deform(request_for(system, std::vector<std::vector<double>>(100, {0.2, 0.1})), 0, listed("Deform"), [] {});
  ASSERT_TRUE(eventually([&] { return only().state() == v1::CALL_RUNNING; }));
  const auto evicted = engine->evict(system, {});
  EXPECT_EQ(evicted.systems, 1u);
  EXPECT_EQ(evicted.in_use, 1u);
  EXPECT_EQ(engine->info().systems_resident(), 0u);
  EXPECT_GE(engine->info().memory_in_use(), evicted.bytes);
  EXPECT_FALSE(job->error()) << "it goes on";
  job.reset();
  EXPECT_TRUE(eventually([&] { return engine->info().memory_in_use() < evicted.bytes; }));
}

TEST_F(OperatedEngine, TakesNewLimitsOver) {
  prepare(sheet_setup(register_mesh(sheet_mesh(20, 20)).id()));
  engine->set_cache_budget(0);
  EXPECT_EQ(engine->info().cache_budget(), 0u);
  EXPECT_TRUE(eventually([&] { return engine->info().systems_resident() == 0; }));
  engine->set_queue_limit(3);
  EXPECT_EQ(engine->info().queue_limit(), 3u);
}

TEST_F(OperatedEngine, ChecksAndCopiesItsStoreBesideTheWork) {
  const std::string geometry = register_mesh(sheet_mesh(20, 20)).id();
  prepare(sheet_setup(geometry));
  const StoreReport well = engine->check_store({});
  EXPECT_EQ(well.outcome, StoreReport::Outcome::well);
  EXPECT_EQ(well.lines.back(), "1 geometries, 1 setups: every file is whole");
  EXPECT_THROW(engine->backup_store("relative"), Error);
  const auto copy = directory.path() / "copy";
  EXPECT_EQ(engine->backup_store(copy).outcome, StoreReport::Outcome::well);
  EXPECT_EQ(check_store(copy).outcome, StoreReport::Outcome::well);
  std::filesystem::permissions(options.data_dir / "geometries" / geometry, std::filesystem::perms::owner_all);
  std::ofstream(options.data_dir / "geometries" / geometry, std::ios::app) << "x";
  const StoreReport faults = engine->check_store({});
  EXPECT_EQ(faults.outcome, StoreReport::Outcome::faults);
  EXPECT_THAT(faults.lines.front(), HasSubstr("geometry " + geometry));
  RunContext stopped;
  std::stop_source stop;
  stop.request_stop();
  stopped.stop = stop.get_token();
  EXPECT_THROW(engine->check_store(stopped), Error);
}

}  // namespace
}  // namespace deform::server::open_calls_test
