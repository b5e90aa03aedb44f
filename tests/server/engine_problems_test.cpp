// SPDX-License-Identifier: GPL-3.0-or-later
// EstimateRequest.list_problems: all that is wrong with a setup in one reply.
#include <gmock/gmock-more-matchers.h>

#include "tests/server/engine_fixture.h"
#include "tests/support/expect_error.h"

namespace deform::server::engine_problems_test {
namespace {

class EngineProblems : public EngineFixture {
 protected:
  v1::EstimateReply estimate(const v1::Setup& setup) {
    v1::EstimateRequest request;
    *request.mutable_setup() = setup;
    request.set_list_problems(true);
    return EngineFixture::estimate(request, {});
  }
  std::vector<std::string> fields(const v1::Setup& setup) {
    std::vector<std::string> result;
    const v1::EstimateReply reply = estimate(setup);
    for (const auto& problem : reply.problems()) result.push_back(problem.field());
    return result;
  }
};

TEST_F(EngineProblems, AGoodSetupIsEstimated) {
  const v1::Setup setup = sheet_setup(register_mesh(sheet_mesh(30, 10)).id());
  const v1::EstimateReply reply = estimate(setup);
  EXPECT_EQ(reply.problems_size(), 0);
  EXPECT_GT(reply.centres(), 0u);
  EXPECT_EQ(reply.system_id(), prepare(setup).id());
}

TEST_F(EngineProblems, WhatCannotBeReadAndWhatIsRefusedAreToldTogether) {
  v1::Setup setup = sheet_setup(register_mesh(sheet_mesh(30, 10)).id());
  const int handle = setup.handles_size(), fixed = setup.fixed_size();
  setup.add_handles()->set_name("no region");
  setup.add_fixed()->mutable_box()->add_min(1);  // two numbers are missing
  setup.add_fixed()->set_group("nobody");
  setup.add_variables()->set_name("moves nothing");
  setup.mutable_method()->mutable_mls();
  auto* line = setup.add_constraints();
  line->set_name("line");
  line->mutable_straight();
  line->add_regions()->add_ids(1);
  setup.add_constraints()->set_name("no kind");
  const std::string last = std::to_string(setup.variables_size() - 1);
  EXPECT_THAT(fields(setup),
              testing::UnorderedElementsAre("handles[" + std::to_string(handle) + "].region",
                                            "fixed[" + std::to_string(fixed) + "]", "fixed[" + std::to_string(fixed + 1) + "]",
                                            "variables[" + last + "]", "constraints[0]", "constraints[1]"));
  v1::EstimateRequest plain;
  *plain.mutable_setup() = setup;
  test::expect_error(ErrorCode::invalid_argument, {"handles[", "region", "is missing"},
                     [&] { EngineFixture::estimate(plain, {}); });
}

TEST_F(EngineProblems, RegionsOfControlPointsAreNotJudgedWithoutTheirLattice) {
  v1::Setup setup = sheet_setup(register_mesh(sheet_mesh(30, 10)).id());
  setup.clear_fixed();
  setup.clear_constraints();
  auto* ffd = setup.mutable_method()->mutable_ffd();
  ffd->set_control(v1::CONTROLS);
  for (int i = 0; i < setup.handles_size(); ++i) {
    auto* region = setup.mutable_handles(i)->mutable_region();
    region->Clear();
    region->add_union_()->mutable_control()->add_ids(static_cast<std::uint32_t>(i));
  }
  EXPECT_THAT(fields(setup), testing::IsEmpty());
  for (const std::uint32_t count : {5, 4}) ffd->mutable_lattice()->add_points(count);  // the third is missing
  EXPECT_THAT(fields(setup), testing::ElementsAre("method.ffd.lattice"));
  ffd->mutable_lattice()->add_points(3);  // fewer than cubic splines take
  EXPECT_THAT(fields(setup), testing::ElementsAre("method.ffd.lattice.points[2]"));
}

/// A server must survive it.
TEST_F(EngineProblems, ConstraintsBesideFurtherMethodsAreToldAsPrepareSaysThem) {
  v1::Setup setup = sheet_setup(register_mesh(sheet_mesh(30, 10)).id());
  auto* stage = setup.add_then();
  stage->mutable_method()->mutable_rbf();
  *stage->add_handles() = setup.handles(0);
  stage->mutable_handles(0)->set_name("again");
  EXPECT_THAT(fields(setup), testing::IsEmpty());
  auto* flat = setup.add_constraints();
  flat->set_name("flat");
  flat->mutable_planar();
  flat->add_regions()->set_all(true);
  const v1::EstimateReply reply = estimate(setup);
  ASSERT_EQ(reply.problems_size(), 1);
  EXPECT_EQ(reply.problems(0).field(), "constraints");
  test::expect_error(ErrorCode::invalid_argument, {reply.problems(0).message().c_str()}, [&] { prepare(setup); });
}

TEST_F(EngineProblems, AGeometryIsNeeded) {
  v1::Setup setup = sheet_setup("");
  setup.add_handles();
  EXPECT_THAT(fields(setup), testing::Contains("geometry"));
  setup = sheet_setup(std::string(64, 'f'));
  test::expect_error(ErrorCode::not_found, {}, [&] { estimate(setup); });
}

TEST_F(EngineProblems, AReplyStaysBelowOneMebibyte) {
  v1::Setup setup = sheet_setup(register_mesh(sheet_mesh(30, 10)).id());
  setup.mutable_method()->mutable_mls();
  for (int i = 0; i < 9000; ++i) setup.add_constraints()->set_name(std::string(100, 'x'));
  const v1::EstimateReply reply = estimate(setup);
  EXPECT_LT(reply.ByteSizeLong(), std::size_t{1} << 20);
  EXPECT_GT(reply.problems_size(), 1000);
  EXPECT_EQ(static_cast<std::uint64_t>(reply.problems_size()) + reply.problems_left_out(), 9000u);
}

}  // namespace
}  // namespace deform::server::engine_problems_test
