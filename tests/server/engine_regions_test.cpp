// SPDX-License-Identifier: GPL-3.0-or-later
// Before anything is prepared: which points become centres, and the surface of volume meshes as a region.
#include "proto/convert/info.h"
#include "tests/server/engine_fixture.h"
#include "tests/server/volume_mesh.h"
#include "tests/support/expect_error.h"

namespace deform::server {
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
    return engine->estimate(request, {});
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
                       [&] { engine->estimate(request, {}); });
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
  test::expect_error(ErrorCode::cancelled, {}, [&] { engine->estimate(request, cancelled); });
  CallContext late;
  late.deadline = RunContext::Clock::now() - std::chrono::seconds(1);
  test::expect_error(ErrorCode::deadline_exceeded, {}, [&] { engine->estimate(request, late); });
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
}  // namespace deform::server
