// SPDX-License-Identifier: GPL-3.0-or-later
// Before anything is prepared: which points become centres, and the surface of volume meshes as a region.
#include <atomic>

#include "proto/convert/info.h"
#include "server/engine/scheduler.h"
#include "server/engine/selection_work.h"
#include "tests/server/engine_fixture.h"
#include "tests/server/volume_mesh.h"
#include "tests/support/expect_error.h"

namespace deform::server::engine_regions_test {
namespace {

std::vector<PointId> listed(const v1::EstimateReply& reply) {
  std::vector<PointId> ids;
  PointId id = 0;
  for (const std::uint32_t step : reply.centre_steps()) ids.push_back(id += step);
  return ids;
}

bool has_note(const v1::EstimateReply& reply, const std::string& part) {
  return std::any_of(reply.notes().begin(), reply.notes().end(),
                     [&](const std::string& note) { return note.find(part) != std::string::npos; });
}

class EngineRegions : public EngineFixture {
 protected:
  v1::EstimateReply estimate(const v1::Setup& setup, bool list_centres) {
    v1::EstimateRequest request;
    *request.mutable_setup() = setup;
    request.set_list_centres(list_centres);
    return EngineFixture::estimate(request, {});
  }
};

TEST_F(EngineRegions, CentresAreListedWhenAskedFor) {
  const auto info = register_mesh(sheet_mesh(30, 10));
  const v1::Setup setup = sheet_setup(info.id());
  EXPECT_EQ(estimate(setup, false).centre_steps_size(), 0);
  const v1::EstimateReply reply = estimate(setup, true);
  const auto ids = listed(reply);
  EXPECT_EQ(ids.size(), reply.centres());
  EXPECT_EQ(ids.size(), prepare(setup).centres());
  EXPECT_TRUE(std::is_sorted(ids.begin(), ids.end()));
  EXPECT_LT(ids.back(), info.points());
  EXPECT_FALSE(has_note(reply, "not listed"));
}

TEST_F(EngineRegions, ANoteSaysWhyCentresAreNotListed) {
  v1::Setup setup = sheet_setup(register_mesh(sheet_mesh(30, 10)).id());
  setup.mutable_method()->mutable_rbf()->set_solver(v1::INCREMENTAL_QR);
  for (const bool mls : {false, true}) {
    if (mls) setup.mutable_method()->mutable_mls();
    const v1::EstimateReply reply = estimate(setup, true);
    EXPECT_EQ(reply.centre_steps_size(), 0);
    EXPECT_TRUE(has_note(reply, "chooses them while preparing"));
    EXPECT_FALSE(has_note(estimate(setup, false), "not listed"));
  }
}

TEST(SelectionWork, CountsRegionsWhereverTheyAre) {
  v1::Setup setup;
  EXPECT_EQ(selection_work(setup, 7).regions, 0u);
  auto& joined = *setup.add_handles()->mutable_region();
  for (int i = 0; i < 3; ++i) joined.add_union_()->mutable_sphere();
  EXPECT_EQ(selection_work(setup, 7).regions, 4u);
  joined.mutable_union_(0)->mutable_complement()->add_intersection()->set_group("g");
  EXPECT_EQ(selection_work(setup, 7).regions, 6u);
  setup.add_fixed()->add_difference()->set_all(true);
  EXPECT_EQ(selection_work(setup, 7).regions, 8u);
  setup.add_constraints()->add_regions()->add_ids(3);
  setup.add_symmetry()->mutable_region()->mutable_box();
  setup.add_symmetry()->mutable_sector()->add_periodic()->mutable_half_space();
  setup.mutable_method()->mutable_mls()->add_weights()->mutable_region()->mutable_cylinder();
  setup.add_then()->add_handles()->mutable_region()->mutable_lattice();
  setup.mutable_then(0)->add_fixed()->mutable_control();
  EXPECT_EQ(selection_work(setup, 7).regions, 14u);
  setup.add_fixed()->mutable_patch();
  setup.add_fixed()->set_open_boundary(true);
  setup.add_fixed()->set_boundary(true);
  setup.add_fixed()->mutable_grow()->mutable_region()->set_all(true);
  const SelectionWork work = selection_work(setup, 7);
  EXPECT_EQ(work.regions, 15 + 4 * SelectionWork::surface_weight);
  EXPECT_EQ(work.product(), 7.0 * static_cast<double>(work.regions));
  EXPECT_NO_THROW(work.check(7 * work.regions));
  test::expect_error(ErrorCode::invalid_argument,
                     {"setup: its 135 regions", "the 7 points", "are 945,", "limit of 944 (--max-setup-work"},
                     [&] { work.check(7 * work.regions - 1); });
  EXPECT_NEAR((SelectionWork{9000, 200'000}.seconds()), 7, 1) << "what it was measured to take";
}

TEST_F(EngineRegions, WhatASetupSelectsIsLimitedBeforeItIsSelected) {
  const auto info = register_mesh(sheet_mesh(30, 10));
  const v1::Setup small = sheet_setup(info.id());
  options.max_setup_work = 300 * selection_work(small, 300).regions;
  reopen();
  EXPECT_EQ(engine->info().limits().max_setup_work(), options.max_setup_work);
  estimate(small, false);
  v1::Setup large = small;
  v1::Box& nothing = *large.add_fixed()->mutable_box();  // which is refused when it is looked at
  for (int k = 0; k < 3; ++k) nothing.add_min(5);
  for (int k = 0; k < 3; ++k) nothing.add_max(6);
  const std::string limit = "limit of " + std::to_string(options.max_setup_work);
  for (const bool list_problems : {false, true}) {
    v1::EstimateRequest request;
    *request.mutable_setup() = large;
    request.set_list_problems(list_problems);
    test::expect_error(ErrorCode::invalid_argument, {"300 points", limit.c_str(), "--max-setup-work"},
                       [&] { EngineFixture::estimate(request); });
  }
  test::expect_error(ErrorCode::invalid_argument, {"300 points", limit.c_str(), "--max-setup-work"}, [&] { prepare(large); });
  prepare(small);
}

// Counted as 3 s of selecting: a preparation and an estimate that wait among those that take long, while short ones go on.
TEST_F(EngineRegions, WhatTakesLongToSelectWaitsAmongWhatTakesLong) {
  options.workers = 1;
  reopen();
  const v1::Setup brief = sheet_setup(register_mesh(sheet_mesh(300, 300)).id());
  v1::Setup lengthy = brief;
  lengthy.mutable_handles(0)->mutable_region()->Clear();
  auto& all = *lengthy.mutable_handles(0)->mutable_region()->add_intersection();
  for (int i = 0; i < 280; ++i) all.add_union_()->set_boundary(true);
  *lengthy.mutable_handles(0)->mutable_region()->add_intersection() = brief.handles(0).region();
  ASSERT_GT(selection_work(lengthy, 90'000).seconds(), Scheduler::short_seconds);
  Gate gate;
  v1::PrepareRequest preparation;
  *preparation.mutable_setup() = lengthy;
  preparation.mutable_setup()->mutable_method()->mutable_rbf()->set_reduction(v1::REDUCTION_RINGS);
  Waiter<v1::SystemInfo> prepared;
  const auto stand = [&](const v1::Progress& progress) {
    if (progress.stage() != "queue") gate.pass();
  };
  engine->prepare(preparation, {}, stand, prepared.callback());
  ASSERT_TRUE(eventually([&] { return gate.waiting() == 1; })) << "on the only thread for what takes long";
  v1::EstimateRequest request;
  *request.mutable_setup() = lengthy;
  std::atomic<bool> done{false};
  Waiter<v1::EstimateReply> late;
  engine->estimate(request, {}, [&, note = late.callback()](Engine::Outcome<v1::EstimateReply> outcome) {
    done = true;
    note(std::move(outcome));
  });
  EXPECT_GT(estimate(brief, false).centres(), 0u);
  EXPECT_FALSE(done) << "the thread for short ones took it";
  gate.open();
  EXPECT_EQ(late.value().handles(0).points(), prepared.value().handles(0).points());
}

TEST_F(EngineRegions, WhatConstraintsSelectIsLimited) {
  options.memory_budget = std::size_t{64} << 20;
  reopen();
  const auto info = register_mesh(sheet_mesh(100, 50));
  v1::Setup setup = sheet_setup(info.id());
  setup.mutable_method()->mutable_shell();
  for (int i = 0; i < 60; ++i) {
    auto* constraint = setup.add_constraints();
    constraint->set_name("plane" + std::to_string(i));
    constraint->mutable_planar();
    constraint->add_regions()->set_all(true);
  }
  estimate(sheet_setup(info.id()), false);  // reads the mesh
  const std::uint64_t before = engine->info().memory_in_use();
  for (const bool list_problems : {false, true}) {
    v1::EstimateRequest request;
    *request.mutable_setup() = setup;
    request.set_list_problems(list_problems);
    test::expect_error(ErrorCode::out_of_budget, {"constraints[", "takes more than 16.0 MiB, a quarter", "smaller regions"},
                       [&] { EngineFixture::estimate(request, {}); });
  }
  test::expect_error(ErrorCode::out_of_budget, {"constraints[", "takes more than 16.0 MiB"}, [&] { prepare(setup); });
  EXPECT_EQ(engine->info().memory_in_use(), before);
  while (setup.constraints_size() > 20) setup.mutable_constraints()->RemoveLast();
  EXPECT_GT(estimate(setup, false).peak_bytes(), 0u);
  EXPECT_EQ(engine->info().memory_in_use(), before);
}

TEST_F(EngineRegions, EstimatesEndWithTheirCalls) {
  v1::EstimateRequest request;
  *request.mutable_setup() = sheet_setup(register_mesh(sheet_mesh(30, 10)).id());
  std::stop_source stop;
  stop.request_stop();
  CallContext cancelled;
  cancelled.stop = stop.get_token();
  test::expect_error(ErrorCode::cancelled, {}, [&] { EngineFixture::estimate(request, cancelled); });
  CallContext late;
  late.deadline = RunContext::Clock::now() - std::chrono::seconds(1);
  test::expect_error(ErrorCode::deadline_exceeded, {}, [&] { EngineFixture::estimate(request, late); });
}

TEST(ListCentres, EndsBelowOneMebibyte) {
  std::vector<PointId> ids(900'000);
  for (std::size_t i = 0; i < ids.size(); ++i) ids[i] = static_cast<PointId>(i);
  v1::EstimateReply reply;
  convert::list_centres(ids, reply);
  EXPECT_EQ(listed(reply), ids) << "a byte for each";
  EXPECT_LE(reply.ByteSizeLong(), 900'016u);
  ids.push_back(ids.back() + 1);
  v1::EstimateReply without;
  convert::list_centres(ids, without);
  EXPECT_EQ(without.centre_steps_size(), 0);
  EXPECT_TRUE(has_note(without, "900001 centres are not listed"));
}

TEST_F(EngineRegions, TheBoundaryOfAVolumeMeshIsItsSurface) {
  constexpr std::size_t n = 5;
  for (const Mesh& mesh : {volume_mesh(n), polyhedral_mesh(n)}) {
    v1::Setup setup;
    setup.set_geometry(register_mesh(mesh).id());
    auto* handle = setup.add_handles();
    handle->set_name("inside");
    handle->mutable_region()->mutable_complement()->set_boundary(true);
    v1::Region& top = *setup.add_fixed();
    top.add_intersection()->set_boundary(true);
    auto& box = *top.add_intersection()->mutable_box();
    for (const double x : {-1., -1., 0.5}) box.add_min(x);
    for (const double x : {2., 2., 2.}) box.add_max(x);
    const v1::EstimateReply reply = estimate(setup, false);
    EXPECT_EQ(reply.handles(0).points(), 64u);
    // Half of the six layers: one of them whole, of the others the rim.
    EXPECT_EQ(reply.fixed_points(), 36u + 2u * 20u);
  }
}

TEST_F(EngineRegions, AnEmptyRegionIsToldTheBoxOfTheModel) {
  v1::Setup setup = sheet_setup(register_mesh(volume_mesh(2)).id());
  setup.clear_fixed();
  setup.clear_variables();
  v1::Region& region = *setup.mutable_handles(0)->mutable_region();
  region.Clear();
  region.mutable_sphere()->set_radius(0.25);
  for (const double x : {7., 7., 7.}) region.mutable_sphere()->add_centre(x);
  test::expect_error(ErrorCode::invalid_argument, {"contains no point; the model's box is [0, 0, 0] to [1, 1, 1]"},
                     [&] { estimate(setup, false); });
}

}  // namespace
}  // namespace deform::server::engine_regions_test
