// SPDX-License-Identifier: GPL-3.0-or-later
// The whole engine without a network: register, prepare, deform, and what restarts and evictions do to it.
#include "server/engine/engine.h"

#include <gmock/gmock-matchers.h>

#include <algorithm>

#include "core/base/vectors.h"
#include "proto/convert/setup.h"
#include "tests/server/engine_fixture.h"
#include "tests/support/expect_error.h"

namespace deform::server::engine_test {
namespace {

using test::expect_error;

class EngineTest : public EngineFixture {
 protected:
  void SetUp() override {
    EngineFixture::SetUp();
    geometry = register_mesh(mesh);
    system = prepare(sheet_setup(geometry.id()));
  }
  /// The same without a server.
  Points reference(const std::vector<double>& variables) {
    if (!direct)
      direct = deform::prepare(std::make_shared<Mesh>(mesh), convert::setup_from_proto(sheet_setup(geometry.id()), 10));
    Design design;
    design.variables = variables;
    return direct->evaluate(design);
  }

  const Mesh mesh = sheet_mesh(60, 30);
  const double diagonal = bounding_box(mesh.points).diagonal();
  v1::GeometryInfo geometry;
  v1::SystemInfo system;
  std::shared_ptr<const System> direct;
};

TEST_F(EngineTest, one_design_bit_for_bit) {
  const DeformedDesigns result = deform(request_for(system.id(), {{0.3, -0.2}}));
  ASSERT_EQ(result.points.size(), 1u);
  EXPECT_EQ(largest_difference(result.points[0], reference({0.3, -0.2})), 0);
  EXPECT_EQ(result.header.points(), mesh.point_count());
  EXPECT_EQ(result.header.geometry_id(), geometry.id());
  ASSERT_EQ(result.results.size(), 1u);
  EXPECT_LE(result.results[0].interpolation_residual(), 1e-9 * diagonal);
  EXPECT_EQ(result.summary.bytes(), mesh.point_count() * sizeof(Vec3));
  EXPECT_FALSE(result.summary.prepared_again());
}

TEST_F(EngineTest, handles_go_where_they_are_told_and_fixed_points_stay) {
  const Points points = deform(request_for(system.id(), {{0.3, 0}})).points[0];
  for (const PointId id : mesh.groups[0].points) EXPECT_LE(largest_difference({points[id]}, {mesh.points[id]}), 1e-9 * diagonal);
  for (const PointId id : mesh.groups[1].points) {
    const Vec3& p = mesh.points[id];
    EXPECT_LE(largest_difference({points[id]}, {{p[0], p[1], p[2] + 0.3}}), 1e-9 * diagonal);
  }
}

TEST_F(EngineTest, the_tolerance_of_every_encoding_is_kept) {
  const Points right = reference({0.3, -0.2});
  for (const v1::Encoding encoding : {v1::RAW_F64, v1::DRACO, v1::DELTA_ZSTD}) {
    for (const double relative : {1e-3, 1e-6, 1e-9}) {
      v1::DeformRequest request = request_for(system.id(), {{0.3, -0.2}}, encoding);
      request.mutable_output()->set_tolerance(relative * diagonal);
      const DeformedDesigns result = deform(request);
      EXPECT_LE(largest_difference(result.points[0], right), relative * diagonal);
      EXPECT_EQ(largest_difference(result.points[0], right), result.results[0].max_error());
    }
  }
  EXPECT_LE(largest_difference(deform(request_for(system.id(), {{0.3, -0.2}}, v1::RAW_F32)).points[0], right), 1e-6);
  const DeformedDesigns by_default = deform(request_for(system.id(), {{0.3, -0.2}}, v1::ENCODING_DEFAULT));
  EXPECT_LE(by_default.results[0].max_error(), 1e-6 * diagonal);
  EXPECT_LT(by_default.summary.bytes(), mesh.point_count() * 12);
}

TEST_F(EngineTest, a_block_that_cannot_be_kept_falls_back_and_says_so) {
  v1::DeformRequest request = request_for(system.id(), {{0.3, -0.2}}, v1::DRACO);
  request.mutable_output()->set_tolerance(1e-14 * diagonal);
  const DeformedDesigns result = deform(request);
  EXPECT_EQ(result.results[0].blocks_fell_back(), (mesh.point_count() + 255) / 256);
  ASSERT_EQ(result.summary.notes_size(), 1);
  EXPECT_NE(result.summary.notes(0).find("RAW_F64"), std::string::npos);
  EXPECT_EQ(largest_difference(result.points[0], reference({0.3, -0.2})), 0);
}

TEST_F(EngineTest, a_population_is_its_designs) {
  std::vector<std::vector<double>> designs;
  for (int d = 0; d < 37; ++d) designs.push_back({0.01 * d, 0.02 * (d % 7)});
  const DeformedDesigns population = deform(request_for(system.id(), designs));
  ASSERT_EQ(population.points.size(), 37u);
  ASSERT_EQ(population.results.size(), 37u);
  for (std::size_t d = 0; d < designs.size(); ++d) {
    EXPECT_LE(largest_difference(population.points[d], reference(designs[d])), 1e-12 * diagonal) << d;
  }
  EXPECT_EQ(engine->info().designs_served(), 37u);
}

TEST_F(EngineTest, motions_of_both_kinds_agree) {
  v1::DeformRequest affine = request_for(system.id(), {{}});
  auto* motion = affine.mutable_designs(0)->add_motions();
  motion->set_handle("right");
  for (const double x : {1., 0., 0., 0.1, 0., 1., 0., 0., 0., 0., 1., 0.2}) motion->add_affine(x);
  v1::DeformRequest free = request_for(system.id(), {{}});
  auto* moved = free.mutable_designs(0)->add_motions();
  moved->set_handle("right");
  const std::vector<Vec3> field(mesh.groups[1].points.size(), {0.1, 0, 0.2});
  moved->add_displacements()->set_xyz(raw_bytes(field, 0, field.size()));
  const DeformedDesigns a = deform(affine), b = deform(free);
  EXPECT_EQ(b.results[0].path(), v1::PATH_DIRECT);
  EXPECT_LE(largest_difference(a.points[0], b.points[0]), 1e-9 * diagonal);
}

TEST_F(EngineTest, derivatives_match_differences_and_each_other) {
  v1::JacobianVectorRequest request;
  request.set_system_id(system.id());
  for (const double x : {0.1, 0.3}) request.add_variables(x);
  for (const double x : {0.7, -1.1}) request.add_direction(x);
  const Points product = jacobian_vector(request).points.at(0);
  constexpr double h = 1e-5;
  const Points ahead = reference({0.1 + 0.7 * h, 0.3 - 1.1 * h}), behind = reference({0.1 - 0.7 * h, 0.3 + 1.1 * h});
  Points difference(product.size());
  for (std::size_t i = 0; i < product.size(); ++i) {
    for (int k = 0; k < 3; ++k) difference[i][k] = (ahead[i][k] - behind[i][k]) / (2 * h);
  }
  EXPECT_LE(largest_difference(product, difference), 1e-7);

  v1::VectorJacobianHeader header;
  header.set_system_id(system.id());
  for (const double x : {0.1, 0.3}) header.add_variables(x);
  Points cotangent(mesh.point_count());
  for (std::size_t i = 0; i < cotangent.size(); ++i) cotangent[i] = {std::sin(0.1 * static_cast<double>(i)), 1, -0.5};
  const std::vector<double> gradient = vector_jacobian(header, cotangent);
  ASSERT_EQ(gradient.size(), 2u);
  double left = 0;
  for (std::size_t i = 0; i < product.size(); ++i) {
    for (int k = 0; k < 3; ++k) left += product[i][k] * cotangent[i][k];
  }
  EXPECT_NEAR(left, 0.7 * gradient[0] - 1.1 * gradient[1], 1e-8 * std::fabs(left));
}

TEST_F(EngineTest, preparing_reports_progress_and_the_system) {
  EXPECT_EQ(stages.front(), "queue");
  EXPECT_NE(std::find(stages.begin(), stages.end(), "select"), stages.end());
  EXPECT_EQ(system.geometry_id(), geometry.id());
  EXPECT_TRUE(system.resident());
  EXPECT_EQ(system.points(), mesh.point_count());
  ASSERT_EQ(system.handles_size(), 1);
  EXPECT_EQ(system.handles(0).points(), 60u);
  EXPECT_EQ(system.fixed_points(), 60u);
  EXPECT_GT(system.centres(), 0u);
  EXPECT_GT(system.bytes(), 0u);
  EXPECT_EQ(system.setup().method().rbf().polynomial_degree(), 1u);
  EXPECT_EQ(prepare(sheet_setup(geometry.id())).id(), system.id());
  EXPECT_EQ(prepare(sheet_setup(geometry.id().substr(0, 10))).id(), system.id());
  EXPECT_EQ(engine->info().cache_misses(), 1u);
}

TEST_F(EngineTest, everything_survives_a_restart_and_is_prepared_again_by_itself) {
  const Points before = deform(request_for(system.id(), {{0.3, -0.2}})).points[0];
  reopen();
  EXPECT_FALSE(engine->get_system(system.id(), {}).resident());
  EXPECT_EQ(engine->list_geometries({}, {}).geometries_size(), 1);
  const DeformedDesigns after = deform(request_for(system.id(), {{0.3, -0.2}}));
  EXPECT_TRUE(after.summary.prepared_again());
  EXPECT_GT(after.summary.prepare_ms(), 0);
  EXPECT_EQ(largest_difference(after.points[0], before), 0);
  EXPECT_TRUE(engine->get_system(system.id(), {}).resident());
  EXPECT_FALSE(deform(request_for(system.id(), {{0.3, -0.2}})).summary.prepared_again());
}

TEST_F(EngineTest, an_evicted_system_is_prepared_again) {
  options.cache_budget = 1;
  reopen();
  for (int i = 0; i < 2; ++i) {
    const DeformedDesigns result = deform(request_for(system.id(), {{0.3, -0.2}}));
    EXPECT_TRUE(result.summary.prepared_again());
    EXPECT_EQ(largest_difference(result.points[0], reference({0.3, -0.2})), 0);
    // It goes when the request lets go of it, which may be after its last reply.
    EXPECT_TRUE(eventually([&] { return engine->info().systems_resident() == 0; }));
  }
  EXPECT_EQ(engine->info().cache_evictions(), 2u);
}

TEST_F(EngineTest, releasing_forgetting_deleting) {
  v1::ReleaseSystemRequest release;
  release.set_id(system.id().substr(0, 12));
  // The request that prepared it has only just ended.
  EXPECT_TRUE(eventually([&] { return engine->info().running() == 0; }));
  EXPECT_EQ(engine->release_system(release, {}).bytes_released(), system.bytes());
  EXPECT_EQ(engine->release_system(release, {}).bytes_released(), 0u);
  EXPECT_FALSE(engine->get_system(system.id(), {}).resident());
  EXPECT_TRUE(deform(request_for(system.id(), {{0, 0}})).summary.prepared_again());
  v1::DeleteGeometryRequest remove;
  remove.set_id(geometry.id());
  expect_error(ErrorCode::failed_precondition, {"1 setups"}, [&] { engine->delete_geometry(remove, {}); });
  release.set_forget(true);
  engine->release_system(release, {});
  expect_error(ErrorCode::not_found, {"unknown id"}, [&] { engine->get_system(system.id(), {}); });
  expect_error(ErrorCode::not_found, {"unknown id"}, [&] { deform(request_for(system.id(), {{0, 0}})); });
  prepare(sheet_setup(geometry.id()));
  remove.set_with_setups(true);
  EXPECT_EQ(engine->delete_geometry(remove, {}).setups_deleted(), 1u);
  expect_error(ErrorCode::not_found, {"unknown id"}, [&] { engine->get_points(geometry.id(), {}); });
  expect_error(ErrorCode::not_found, {"unknown id"}, [&] { deform(request_for(system.id(), {{0, 0}})); });
  EXPECT_TRUE(eventually([&] { return engine->info().memory_in_use() == 0; })) << engine->info().memory_in_use();
}

TEST_F(EngineTest, listing_systems) {
  const v1::GeometryInfo other = register_mesh(sheet_mesh(10, 8));
  prepare(sheet_setup(other.id()));
  EXPECT_EQ(engine->list_systems({}, {}).systems_size(), 2);
  v1::ListSystemsRequest request;
  request.set_geometry_id(other.id().substr(0, 9));
  const v1::ListSystemsReply reply = engine->list_systems(request, {});
  ASSERT_EQ(reply.systems_size(), 1);
  EXPECT_EQ(reply.systems(0).geometry_id(), other.id());
  EXPECT_TRUE(reply.systems(0).resident());
  request.set_page_size(1);
  request.clear_geometry_id();
  const v1::ListSystemsReply first = engine->list_systems(request, {});
  request.set_page_token(first.next_page_token());
  EXPECT_NE(engine->list_systems(request, {}).systems(0).id(), first.systems(0).id());
  EXPECT_EQ(engine->get_geometry(other.id(), {}).setups(), 1u);
}

TEST_F(EngineTest, lists_of_large_entries_come_in_pages_below_a_mebibyte) {
  constexpr std::size_t mebibyte = std::size_t{1} << 20;
  std::vector<std::string> systems, geometries;
  for (int i = 0; i < 5; ++i) {
    Mesh large = sheet_mesh(6, 5, 0.1 * i);
    for (int g = 0; g < 100; ++g) large.groups.push_back({std::string(4000, 'g') + std::to_string(g), {0}, {}});
    geometries.push_back(register_mesh(large).id());
    v1::Setup setup = sheet_setup(geometries.back());
    for (int k = 0; k < 100; ++k) {
      v1::DesignVariable& variable = *setup.add_variables();
      variable = setup.variables(0);
      variable.set_name(std::string(4000, 'v') + std::to_string(k));
    }
    systems.push_back(prepare(setup).id());
  }
  const auto pages = [&](auto request, const auto& list, const auto& add) {
    int count = 0;
    do {
      const auto reply = list(request);
      EXPECT_LT(reply.ByteSizeLong(), mebibyte);
      add(reply);
      request.set_page_token(reply.next_page_token());
      ++count;
    } while (!request.page_token().empty() && count < 100);
    return count;
  };
  std::vector<std::string> seen;
  EXPECT_EQ(pages(
                v1::ListSystemsRequest(), [&](const auto& request) { return engine->list_systems(request, {}); },
                [&](const auto& reply) {
                  for (const auto& info : reply.systems()) seen.push_back(info.id());
                }),
            3);
  v1::ListSystemsRequest short_ones;
  short_ones.set_omit_setup(true);
  EXPECT_EQ(engine->list_systems(short_ones, {}).systems_size(), 6) << "in one page";
  EXPECT_FALSE(engine->list_systems(short_ones, {}).systems(0).has_setup());
  v1::PrepareRequest request;
  *request.mutable_setup() = engine->get_system(systems[0], {}).setup();
  request.set_omit_setup(true);
  Waiter<v1::SystemInfo> waiter;
  engine->prepare(request, {}, {}, waiter.callback());
  const v1::SystemInfo info = waiter.value();
  EXPECT_EQ(info.id(), systems[0]);
  EXPECT_FALSE(info.has_setup());
  EXPECT_TRUE(engine->get_system(systems[0], {}).has_setup());
  systems.push_back(system.id());
  EXPECT_THAT(seen, testing::UnorderedElementsAreArray(systems)) << "each once";
  seen.clear();
  EXPECT_EQ(pages(
                v1::ListGeometriesRequest(), [&](const auto& request) { return engine->list_geometries(request, {}); },
                [&](const auto& reply) {
                  for (const auto& info : reply.geometries()) seen.push_back(info.id());
                }),
            3);
  geometries.push_back(geometry.id());
  EXPECT_THAT(seen, testing::UnorderedElementsAreArray(geometries));
}

/// Its message is kept as long as the system is, and stays out of answers that it would make too large.
TEST_F(EngineTest, a_large_setup_is_charged_and_told_by_a_call_of_its_own) {
  v1::Setup large = sheet_setup(geometry.id());
  v1::Region list;
  for (PointId id = 662; id < 712; ++id) list.add_ids(id);  // in the middle of a row
  v1::Region& fixed = *large.add_fixed();
  for (int i = 0; i < 12'000; ++i) *fixed.add_union_() = list;
  const std::size_t before = engine->info().cache_bytes();
  const v1::SystemInfo prepared = prepare(large);
  EXPECT_FALSE(prepared.has_setup());
  EXPECT_GT(prepared.setup_bytes(), 1'000'000u);
  EXPECT_GE(engine->info().cache_bytes() - before, prepared.bytes() + 2 * large.SpaceUsedLong() * 9 / 10);
  EXPECT_EQ(engine->get_system(prepared.id(), {}).setup_bytes(), prepared.setup_bytes());
  EXPECT_FALSE(engine->get_system(prepared.id(), {}).has_setup());
  const v1::ListSystemsReply listed = engine->list_systems({}, {});
  EXPECT_EQ(listed.systems_size(), 2);
  EXPECT_LT(listed.ByteSizeLong(), 1'000'000u);
  v1::Setup canonical;
  ASSERT_TRUE(canonical.ParseFromString(engine->get_setup(prepared.id().substr(0, 12), {})));
  EXPECT_EQ(canonical.ByteSizeLong(), prepared.setup_bytes());
  EXPECT_EQ(convert::system_id(canonical), prepared.id());
  EXPECT_TRUE(engine->get_system(system.id(), {}).has_setup()) << "a small one is told with it";

  options.memory_budget = 3 * large.SpaceUsedLong();
  options.cache_budget = 0;
  reopen();
  expect_error(ErrorCode::out_of_budget, {"reading the setup"}, [&] { prepare(large); });
  EXPECT_EQ(engine->info().memory_in_use(), 0u);
}

TEST_F(EngineTest, what_waits_for_preparations_leaves_room_for_what_is_there) {
  options.workers = 1;
  options.queue_limit = 8;
  reopen();
  prepare(sheet_setup(geometry.id()));
  StandingPreparations standing(*engine, options, geometry.id());
  v1::PrepareRequest request;
  *request.mutable_setup() = sheet_setup(geometry.id());
  std::vector<std::unique_ptr<Waiter<v1::SystemInfo>>> prepared;
  v1::EstimateRequest question;
  *question.mutable_setup() = request.setup();
  v1::DetectRequest detection;
  detection.set_geometry_id(geometry.id());
  CallContext call;
  for (int i = 0; i < 60; ++i) {
    call.client = "client " + std::to_string(i);
    request.mutable_setup()->set_seed(static_cast<std::uint64_t>(i) + 1);
    auto waiter = std::make_unique<Waiter<v1::SystemInfo>>();
    try {
      engine->prepare(request, call, {}, waiter->callback());
      prepared.push_back(std::move(waiter));
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::out_of_budget);
      EXPECT_GT(error.retry_after_ms(), 0u);
    }
  }
  EXPECT_EQ(prepared.size(), 6u) << "of eight places two are taken by those who stand";
  const v1::ServerInfo full = engine->info();
  EXPECT_EQ(full.queue_length(), 8u);
  EXPECT_EQ(full.preparation_queue_length(), 8u);
  const auto nobody = [](const auto&) { ADD_FAILURE() << "it was let in"; };
  expect_error(ErrorCode::out_of_budget, {"queue for preparations is full"}, [&] { engine->estimate(question, call, nobody); });
  expect_error(ErrorCode::out_of_budget, {"queue for preparations is full"}, [&] { engine->detect(detection, call, nobody); });
  v1::PrepareRequest known;
  *known.mutable_setup() = sheet_setup(geometry.id());
  for (int i = 0; i < 20; ++i) EXPECT_EQ(deform(request_for(system.id(), {{0.1, 0.1}}), call).results.size(), 1u);
  EXPECT_EQ(prepare(known.setup(), call).id(), system.id()) << "nor does what is prepared already wait";
  standing.go_on();
  for (auto& each : prepared) each->value();
  EXPECT_TRUE(eventually([&] { return engine->info().queue_length() == 0; }));
}

TEST_F(EngineTest, a_cancelled_call_converts_no_setup) {
  std::stop_source stop;
  stop.request_stop();
  CallContext call;
  call.stop = stop.get_token();
  v1::Setup setup = sheet_setup(std::string(64, 'f'));
  expect_error(ErrorCode::not_found, {}, [&] { prepare(setup); });
  expect_error(ErrorCode::cancelled, {}, [&] { prepare(setup, call); });
}

TEST_F(EngineTest, an_estimate_is_a_call_that_computes) {
  v1::EstimateRequest request;
  *request.mutable_setup() = sheet_setup(geometry.id());
  OpenCalls calls;
  CallContext call;
  call.open = calls.open({}, {});
  EXPECT_EQ(calls.list({}, 0, 10).calls(0).state(), v1::CALL_OPEN);
  EngineFixture::estimate(request, call);
  EXPECT_EQ(calls.list({}, 0, 10).calls(0).state(), v1::CALL_RUNNING);
  std::stop_source stop;
  call.stop = stop.get_token();
  stop.request_stop();
  expect_error(ErrorCode::cancelled, {"caller"}, [&] { EngineFixture::estimate(request, call); });
  CallContext late;
  late.deadline = RunContext::Clock::now();
  expect_error(ErrorCode::deadline_exceeded, {}, [&] { EngineFixture::estimate(request, late); });
  EXPECT_TRUE(engine->drain(std::chrono::seconds(60))) << "no estimate is left among the calls";
  expect_error(ErrorCode::unavailable, {"shutting down"}, [&] { EngineFixture::estimate(request, {}); });
}

// With all threads for preparations busy: estimates wait for one, hold no worker, count as calls and can be cancelled.
TEST_F(EngineTest, estimates_take_a_turn_among_preparations) {
  options.workers = 1;
  reopen();
  prepare(sheet_setup(geometry.id()));
  StandingPreparations standing(*engine, options, geometry.id());
  v1::EstimateRequest request;
  *request.mutable_setup() = sheet_setup(geometry.id());
  request.set_list_centres(true);
  std::stop_source stop;
  CallContext call;
  call.client = "a";
  call.quota.calls = 4;  // of which two stand
  CallContext given_up = call;
  given_up.stop = stop.get_token();
  Waiter<v1::EstimateReply> first, second, third;
  std::atomic<int> done{0};
  const auto noted = [&](Waiter<v1::EstimateReply>& waiter) {
    return [&done, callback = waiter.callback()](Engine::Outcome<v1::EstimateReply> outcome) {
      if (outcome.value) ++done;
      callback(std::move(outcome));
    };
  };
  engine->estimate(request, given_up, noted(first));
  engine->estimate(request, call, noted(second));
  expect_error(ErrorCode::out_of_budget, {"quota calls"}, [&] { EngineFixture::estimate(request, call); });
  EXPECT_EQ(deform(request_for(system.id(), {{0.1, 0.1}})).results.size(), 1u) << "a worker is free";
  EXPECT_EQ(done, 0);
  EXPECT_EQ(engine->info().preparation_queue_length(), 2 + 2u);
  stop.request_stop();
  expect_error(ErrorCode::cancelled, {}, [&] { first.value(); });
  EXPECT_TRUE(eventually([&] {  // it counts until it has been told
    try {
      engine->estimate(request, call, noted(third));
      return true;
    } catch (const Error&) {
      return false;
    }
  }));
  standing.go_on();
  EXPECT_EQ(second.value().system_id(), system.id());
  EXPECT_GT(third.value().centre_steps_size(), 0);
  EXPECT_EQ(done, 2);
}

TEST_F(EngineTest, estimates_bound_what_is_used) {
  v1::EstimateRequest request;
  *request.mutable_setup() = sheet_setup(geometry.id());
  const v1::EstimateReply estimate = EngineFixture::estimate(request, {});
  EXPECT_EQ(estimate.system_id(), system.id());
  EXPECT_TRUE(estimate.resident());
  EXPECT_TRUE(estimate.fits());
  EXPECT_GE(estimate.resident_bytes(), system.bytes());
  EXPECT_GE(estimate.peak_bytes(), estimate.resident_bytes());
  EXPECT_GE(estimate.centres(), system.centres());
  EXPECT_EQ(estimate.fixed_points(), 60u);
  ASSERT_EQ(estimate.handles_size(), 1);
  EXPECT_EQ(estimate.handles(0).points(), 60u);
}

TEST_F(EngineTest, flat_geometries_get_the_thin_plate_kernel_unless_told_otherwise) {
  Mesh flat = mesh;
  for (Vec3& p : flat.points) p[2] = 0.5;
  v1::Setup setup = sheet_setup(register_mesh(flat, "flat").id());
  setup.mutable_method()->mutable_rbf()->clear_kernel();
  EXPECT_EQ(prepare(setup).setup().method().rbf().kernel(), v1::THIN_PLATE);
  setup.mutable_method()->mutable_rbf()->set_kernel(v1::TRIHARMONIC);
  EXPECT_EQ(prepare(setup).setup().method().rbf().kernel(), v1::TRIHARMONIC);
  setup.set_geometry(geometry.id());
  setup.mutable_method()->mutable_rbf()->clear_kernel();
  EXPECT_EQ(prepare(setup).setup().method().rbf().kernel(), v1::TRIHARMONIC);
}

TEST_F(EngineTest, the_iterative_solver_is_a_system_like_others) {
  v1::Setup setup = sheet_setup(geometry.id());
  setup.mutable_method()->mutable_rbf()->set_solver(v1::ITERATIVE);
  setup.mutable_method()->mutable_rbf()->set_tolerance(1e-8);
  const v1::SystemInfo info = prepare(setup);
  EXPECT_EQ(info.solver(), v1::ITERATIVE);
  EXPECT_EQ(info.tolerance(), 1e-8);
  EXPECT_NE(info.id(), system.id());
  setup.mutable_method()->mutable_rbf()->set_tolerance(0.5);
  expect_error(ErrorCode::invalid_argument, {"method.rbf.tolerance", "0.5"}, [&] { prepare(setup); });
}

TEST_F(EngineTest, registering_again_is_answered_at_once) {
  v1::GeometryHeader header = header_of(mesh, "again");
  header.set_id(geometry.id());
  const auto upload = engine->begin_upload(header, {});
  EXPECT_TRUE(upload->already_stored());
  const v1::GeometryInfo info = upload->finish();
  EXPECT_TRUE(info.existed());
  EXPECT_EQ(info.id(), geometry.id());
  EXPECT_EQ(info.setups(), 1u);
  EXPECT_TRUE(register_mesh(mesh).existed());
  EXPECT_EQ(*engine->get_points(geometry.id(), {}), mesh.points);
}

TEST_F(EngineTest, an_upload_that_is_let_go_leaves_nothing) {
  const std::size_t before = engine->info().memory_in_use();
  {
    const auto upload = engine->begin_upload(header_of(sheet_mesh(50, 50)), {});
    upload->add(upload_messages(sheet_mesh(50, 50))[0]);
    EXPECT_GT(engine->info().memory_in_use(), before);
  }
  EXPECT_EQ(engine->info().memory_in_use(), before);
  EXPECT_EQ(engine->info().geometries(), 1u);
}

TEST_F(EngineTest, a_failing_preparation_leaves_nothing) {
  v1::Setup setup = sheet_setup(geometry.id());
  setup.mutable_handles(0)->mutable_region()->set_group("rigth");
  expect_error(ErrorCode::invalid_argument, {"rigth", "\"right\""}, [&] { prepare(setup); });
  EXPECT_EQ(engine->info().setups(), 1u);
  std::stop_source stop;
  CallContext cancelled;
  cancelled.stop = stop.get_token();
  stop.request_stop();
  setup = sheet_setup(geometry.id());
  setup.set_seed(3);
  expect_error(ErrorCode::cancelled, {}, [&] { prepare(setup, cancelled); });
  CallContext late;
  late.deadline = RunContext::Clock::now();
  expect_error(ErrorCode::deadline_exceeded, {}, [&] { prepare(setup, late); });
  EXPECT_EQ(engine->info().setups(), 1u);
}

TEST_F(EngineTest, what_never_fits_is_refused_with_the_numbers) {
  options.memory_budget = 400'000;
  reopen();
  try {
    deform(request_for(system.id(), {{0, 0}}));
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::out_of_budget) << error.what();
    EXPECT_EQ(error.retry_after_ms(), 0u);
    EXPECT_NE(std::string(error.what()).find("390.6 KiB"), std::string::npos) << error.what();
  }
  EXPECT_LE(engine->info().memory_in_use(), 400'000u);
}

TEST_F(EngineTest, a_drained_engine_finishes_and_then_refuses) {
  EXPECT_TRUE(engine->drain(std::chrono::seconds(60)));
  EXPECT_TRUE(engine->info().draining());
  expect_error(ErrorCode::unavailable, {"shutting down"}, [&] { deform(request_for(system.id(), {{0, 0}})); });
  expect_error(ErrorCode::unavailable, {"shutting down"}, [&] { prepare(sheet_setup(geometry.id())); });
  expect_error(ErrorCode::unavailable, {"shutting down"}, [&] { register_mesh(mesh); });
  EXPECT_EQ(engine->get_geometry(geometry.id(), {}).points(), mesh.point_count());
  EXPECT_TRUE(engine->drain(std::chrono::seconds(60)));
}

TEST_F(EngineTest, draining_cancels_what_is_not_done_in_time) {
  std::vector<std::vector<double>> designs(100, {0.1, 0.1});
  const auto job = engine->deform(request_for(system.id(), designs), 0, {}, [] {});  // nobody reads
  EXPECT_FALSE(engine->drain(std::chrono::milliseconds(50)));
  v1::DeformReply reply;
  EXPECT_EQ(job->poll(reply), DeformJob::Poll::done);
  EXPECT_EQ(job->error()->code(), ErrorCode::unavailable);
  engine.reset();  // a job may outlive its engine
}

TEST_F(EngineTest, jobs_that_are_read_finish_while_draining) {
  Doorbell bell;
  const auto job = engine->deform(request_for(system.id(), {{0.1, 0}}), 0, {}, bell.ring());
  std::thread drainer([&] { EXPECT_TRUE(engine->drain(std::chrono::seconds(60))); });
  v1::DeformReply reply;
  int replies = 0;
  for (DeformJob::Poll poll; (poll = job->poll(reply)) != DeformJob::Poll::done;) {
    if (poll == DeformJob::Poll::pending) {
      bell.wait();
    } else {
      ++replies;
    }
  }
  drainer.join();
  EXPECT_FALSE(job->error());
  EXPECT_EQ(replies, 1 + 8 + 1 + 1);
}

TEST_F(EngineTest, info_tells_the_limits_and_the_load) {
  const v1::ServerInfo info = engine->info();
  EXPECT_FALSE(info.version().empty());
  EXPECT_EQ(info.workers(), 2u);
  EXPECT_EQ(info.memory_budget(), options.memory_budget);
  EXPECT_EQ(info.cache_budget(), options.memory_budget / 2);
  EXPECT_EQ(info.cache_bytes(), system.bytes());
  EXPECT_EQ(info.limits().max_points(), 100'000u);
  EXPECT_EQ(info.geometries(), 1u);
  EXPECT_EQ(info.setups(), 1u);
  EXPECT_GT(info.resident_set_bytes(), 0u);
}

TEST_F(EngineTest, bodies_that_nothing_holds_are_noted) {
  Mesh two = mesh;
  const auto first = static_cast<PointId>(two.point_count());
  for (const Vec3& x : mesh.points) two.points.push_back(x + Vec3{0, 0, 7});
  two.face_sizes.insert(two.face_sizes.end(), mesh.face_sizes.begin(), mesh.face_sizes.end());
  for (const PointId point : mesh.face_points) two.face_points.push_back(first + point);
  const v1::Setup setup = sheet_setup(register_mesh(two).id());
  const std::string start = "A body of " + std::to_string(mesh.point_count()) + " points around (";
  const auto noted = [&](const auto& notes) {
    return std::any_of(notes.begin(), notes.end(), [&](const std::string& note) { return note.starts_with(start); });
  };
  v1::EstimateRequest request;
  *request.mutable_setup() = setup;
  EXPECT_TRUE(noted(EngineFixture::estimate(request, {}).notes()));
  EXPECT_TRUE(noted(prepare(setup).notes()));
  EXPECT_FALSE(noted(system.notes()));
}

TEST_F(EngineTest, a_half_model_keeps_its_plane) {
  v1::Setup setup = sheet_setup(geometry.id());
  v1::SymmetryPlane& plane = *setup.add_symmetry();
  for (const double x : {0., 0., 0.}) plane.add_point(x);
  for (const double x : {0., 1., 0.}) plane.add_normal(x);
  const v1::SystemInfo half = prepare(setup);
  EXPECT_NE(half.id(), system.id());
  ASSERT_EQ(half.setup().symmetry_size(), 1);
  EXPECT_EQ(half.setup().symmetry(0).normal(1), 1);
  const std::string note = "Symmetry: plane 1 holds 60 points, 4 of them centres.";
  EXPECT_NE(std::find(half.notes().begin(), half.notes().end(), note), half.notes().end());
  const Design design{{0.3, -0.2}, {}};
  const Points expected = deform::prepare(std::make_shared<Mesh>(mesh), convert::setup_from_proto(setup, 10))->evaluate(design);
  reopen();  // the plane is stored
  const Points got = deform(request_for(half.id(), {{0.3, -0.2}})).points[0];
  EXPECT_EQ(largest_difference(got, expected), 0);
  EXPECT_GT(largest_difference(got, reference({0.3, -0.2})), 1e-6);
  for (std::size_t i = 0; i < 60; ++i) EXPECT_EQ(got[i][1], 0);
}

TEST_F(EngineTest, half_models_that_run_through_themselves_are_doubtful) {
  v1::Setup setup = sheet_setup(geometry.id());
  v1::SymmetryPlane& plane = *setup.add_symmetry();
  for (const double x : {0., 0., 0.}) plane.add_point(x);
  for (const double x : {0., 1., 0.}) plane.add_normal(x);
  // The free points between the plane and a handle that comes near to it are pushed across.
  setup.mutable_handles(0)->mutable_region()->clear_group();
  auto* box = setup.mutable_handles(0)->mutable_region()->mutable_box();
  for (const double x : {0.4, 0.5, -1.0}) box->add_min(x);
  for (const double x : {0.6, 0.8, 1.0}) box->add_max(x);
  setup.clear_variables();
  auto* in = setup.add_variables();
  in->set_name("in");
  in->set_handle(setup.handles(0).name());
  for (const double x : {0., -1., 0.}) in->add_translate(x);
  const v1::SystemInfo half = prepare(setup);
  for (const bool again : {false, true}) {
    if (again) reopen();  // what is restored knows the plane, too
    const auto deformed = deform(request_for(half.id(), {{0.01}, {0.6}}));
    std::array<std::size_t, 2> across{};
    double farthest = 0;
    for (std::size_t d = 0; d < 2; ++d) {
      for (const Vec3& p : deformed.points[d]) {
        across[d] += p[1] < -1e-6;
        if (d == 1) farthest = std::max(farthest, -p[1]);
      }
      EXPECT_EQ(deformed.results[d].points_across_symmetry(), across[d]);
    }
    char text[40];
    std::snprintf(text, sizeof text, "%.3g", farthest);
    EXPECT_EQ(across[0], 0U);
    ASSERT_GT(across[1], 5U);
    EXPECT_TRUE(deformed.results[0].has_points_across_symmetry());
    EXPECT_NE(deformed.results[1].verdict(), v1::VERDICT_GOOD);
    EXPECT_THAT(deformed.results[1].reasons(),
                testing::Contains(std::to_string(across[1]) + " points crossed a symmetry plane: "
                                                              "the whole model runs through itself"));
    EXPECT_THAT(deformed.results[1].warnings(),
                testing::Contains(testing::HasSubstr(std::to_string(across[1]) + " of " + std::to_string(mesh.point_count()) +
                                                     " points crossed a symmetry plane, point ")));
    EXPECT_THAT(deformed.results[1].warnings(), testing::Contains(testing::HasSubstr(std::string("farthest, by ") + text)));
  }
}

}  // namespace
}  // namespace deform::server::engine_test
