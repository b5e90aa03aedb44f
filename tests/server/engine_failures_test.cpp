// SPDX-License-Identifier: GPL-3.0-or-later
// FAILURES_PER_DESIGN: a bad design fails alone, whatever is wrong with it, and the others are as if it had not been there.
#include <limits>

#include "tests/server/engine_fixture.h"
#include "tests/server/volume_mesh.h"
#include "tests/support/expect_error.h"

namespace deform::server::engine_failures_test {
namespace {

class EngineFailures : public EngineFixture {
 protected:
  std::string prepare_sheet() { return prepare(sheet_setup(register_mesh(sheet_mesh(12, 9)).id())).id(); }
  std::string prepare_block(Mesh mesh, int dimensions) {
    return prepare(block_setup_message(register_mesh(mesh).id(), dimensions)).id();
  }
  static v1::DeformRequest per_design(v1::DeformRequest request) {
    request.set_failures(v1::FAILURES_PER_DESIGN);
    return request;
  }
  static v1::DeformRequest with_designs(const v1::DeformRequest& like, const std::vector<v1::Design>& designs) {
    v1::DeformRequest request = like;
    request.clear_designs();
    for (const auto& design : designs) *request.add_designs() = design;
    return request;
  }
  static v1::Design values(const std::vector<double>& numbers) {
    v1::Design design;
    for (const double x : numbers) design.add_variables(x);
    return design;
  }
  static v1::Design affine(const std::string& handle, double scale, double offset = 0) {
    v1::Design design;
    v1::Motion& motion = *design.add_motions();
    motion.set_handle(handle);
    for (const double x : {scale, 0., 0., 0., 0., scale, 0., 0., 0., 0., scale, 0.}) motion.add_affine(x);
    motion.set_affine(3, offset);
    return design;
  }
  /// Results come in any order.
  static std::map<std::uint32_t, v1::DesignResult> by_design(const DeformedDesigns& deformed) {
    std::map<std::uint32_t, v1::DesignResult> results;
    for (const auto& result : deformed.results) {
      EXPECT_TRUE(results.emplace(result.design(), result).second) << result.design() << " has two results";
    }
    return results;
  }
  static void expect_failed(const v1::DesignResult& result, std::uint32_t code, const std::string& message) {
    EXPECT_TRUE(result.has_error()) << result.design();
    EXPECT_EQ(result.error().code(), code);
    EXPECT_EQ(result.error().message().substr(0, message.size()), message);
    v1::DesignResult rest = result;
    rest.clear_design();
    rest.clear_error();
    EXPECT_EQ(rest.ByteSizeLong(), 0u) << rest.DebugString();
  }
  /// Sends the good designs by themselves, and with the bad ones between them: the same points and findings.
  void expect_same_without(const v1::DeformRequest& like, const std::vector<v1::Design>& good, const v1::Design& bad,
                           const std::string& message) {
    const auto alone = deform(with_designs(like, good));
    const std::size_t n = good.size();
    for (const std::vector<std::size_t>& places :
         {std::vector<std::size_t>{0}, {n}, {1}, {0, 1, n + 2}, std::vector<std::size_t>{n / 2, n / 2 + 1}}) {
      std::vector<v1::Design> mixed = good;
      for (const std::size_t place : places) mixed.insert(mixed.begin() + static_cast<std::ptrdiff_t>(place), bad);
      const auto deformed = deform(per_design(with_designs(like, mixed)));
      EXPECT_EQ(deformed.header.designs(), mixed.size());
      const auto results = by_design(deformed);
      ASSERT_EQ(results.size(), mixed.size());
      std::size_t next = 0;
      for (std::uint32_t d = 0; d < mixed.size(); ++d) {
        if (std::count(places.begin(), places.end(), d) > 0) {
          expect_failed(results.at(d), 3, message);
          continue;
        }
        EXPECT_EQ(deformed.points[d], alone.points[next]) << d;
        v1::DesignResult result = results.at(d);
        result.set_design(alone.results[next].design());
        EXPECT_EQ(result.DebugString(), alone.results[next].DebugString());
        ++next;
      }
      EXPECT_EQ(next, n);
    }
  }
};

TEST_F(EngineFailures, WhateverIsWrongWithADesign) {
  const auto like = request_for(prepare_sheet(), {});
  const std::vector<v1::Design> good{values({0.1, 0}), affine("right", 1.1), values({0.2, 0.3})};
  expect_same_without(like, good, values({0.9, 0}), "variables[0] (\"up\"): 0.9");
  expect_same_without(like, good, values({0.1}), "variables: expected none or 2 values, got 1");
  expect_same_without(like, good, values({0.1, std::numeric_limits<double>::quiet_NaN()}), "variables[1]: must be a finite");
  expect_same_without(like, good, affine("rigth", 2), "motions[0].handle: the setup has no handle \"rigth\"");
  v1::Design twice = affine("right", 2);  // found when it is bound
  twice.MergeFrom(affine("right", 2));
  expect_same_without(like, good, twice, "motions[1] (handle \"right\"): the handle has two motions");
  v1::Design both = affine("right", 2);
  both.MergeFrom(values({0.1, 0}));
  expect_same_without(like, good, both, "motions[0] (handle \"right\"): the handle is moved by design variables");
  v1::Design continued = values({0.1, 0});
  continued.set_continues(true);
  expect_same_without(like, good, continued, "continues: there is nothing");
}

TEST_F(EngineFailures, MoreThanShareAPass) {
  const auto like = request_for(prepare_sheet(), {});
  std::vector<v1::Design> good;
  for (int k = 0; k < 40; ++k) good.push_back(values({0.01 * k, 0}));
  expect_same_without(like, good, values({0.9, 0}), "variables[0]");
}

TEST_F(EngineFailures, WithoutItTheRequestFails) {
  auto request = request_for(prepare_sheet(), {{0.1, 0}, {0.9, 0}});
  for (const auto failures : {v1::FAILURES_DEFAULT, v1::FAIL_REQUEST}) {
    request.set_failures(failures);
    test::expect_error(ErrorCode::invalid_argument, {"designs[1].variables[0]"}, [&] { deform(request); });
  }
  request.set_failures(static_cast<v1::Failures>(9));
  test::expect_error(ErrorCode::invalid_argument, {"failures", "9"}, [&] { deform(request); });
}

TEST_F(EngineFailures, WhatIsWrongWithTheRequestFailsIt) {
  auto request = per_design(request_for(prepare_sheet(), {{0.1, 0}, {0.9, 0}}));
  request.mutable_splitting()->set_mode(v1::SPLIT_UNIFORM);
  test::expect_error(ErrorCode::failed_precondition, {"no cells"}, [&] { deform(request); });
  request.clear_splitting();
  request.set_solver_tolerance(7);
  test::expect_error(ErrorCode::invalid_argument, {"solver_tolerance"}, [&] { deform(request); });
  request.clear_designs();
  test::expect_error(ErrorCode::invalid_argument, {""}, [&] { deform(request); });
}

TEST_F(EngineFailures, AllCanBeBad) {
  const std::string system = prepare_sheet();
  const auto served = engine->info().designs_served();
  const auto deformed = deform(per_design(request_for(system, {{0.9, 0}, {0.1}, {0, 0, 0}})));
  ASSERT_EQ(by_design(deformed).size(), 3u);
  for (const auto& result : deformed.results) expect_failed(result, 3, "variables");
  EXPECT_EQ(deformed.summary.bytes(), 0u);
  EXPECT_EQ(engine->info().designs_served(), served);
  deform(per_design(request_for(system, {{0.9, 0}, {0.1, 0}})));
  EXPECT_EQ(engine->info().designs_served(), served + 1) << "only those that were";
  EXPECT_TRUE(eventually([&] { return engine->info().running() == 0; }));
}

TEST_F(EngineFailures, WithChecksAndSplitting) {
  auto like = request_for(prepare_block(test::square(20), 2), {});
  const std::vector<v1::Design> good{values({0.5, 0}), values({2.3, 0}), values({0, 0.05})};
  like.set_check(v1::CELL_QUALITY);
  expect_same_without(like, good, values({0.9}), "variables");
  like.mutable_splitting()->set_mode(v1::SPLIT_UNIFORM);
  like.mutable_splitting()->set_most_steps(5);
  expect_same_without(like, good, values({0.9}), "variables");
  // Fails only when its cells are looked at.
  expect_same_without(like, good, affine("block", 1.7e308, 1.7e308), "points[");
}

TEST_F(EngineFailures, ABadDesignOfAWarmSequenceIsNotInIt) {
  v1::Setup setup = sheet_setup(register_mesh(sheet_mesh(12, 9)).id());
  setup.mutable_method()->mutable_shell();
  auto& constraint = *setup.add_constraints();
  constraint.set_name("flat");
  constraint.mutable_planar();
  auto& box = *constraint.add_regions()->mutable_box();
  for (const double x : {0.4, -1.0, -1.0}) box.add_min(x);
  for (const double x : {0.6, 2.0, 1.0}) box.add_max(x);
  auto like = request_for(prepare(setup).id(), {});
  like.set_warm_start(true);
  const std::vector<v1::Design> good{values({0.1, 0}), values({0.11, 0.01}), values({0.12, 0})};
  expect_same_without(like, good, values({0.9, 0}), "variables[0]");
  v1::Design twice = affine("right", 1.2);
  twice.MergeFrom(affine("right", 1.2));
  expect_same_without(like, good, twice, "motions[1]");
}

}  // namespace
}  // namespace deform::server::engine_failures_test
