// SPDX-License-Identifier: GPL-3.0-or-later
// What is said about the displacements and the faces of every design.
#include "core/quality/displacement.h"
#include "core/quality/face_intersections.h"
#include "core/quality/flipped_faces.h"
#include "server/engine/step_plan.h"
#include "tests/server/engine_fixture.h"
#include "tests/server/volume_mesh.h"

namespace deform::server::engine_faces_test {
namespace {

class EngineFaces : public EngineFixture {
 protected:
  /// An almost flat sheet (in a plane its faces would be cells) whose middle moves along it and up: far along, it folds over.
  v1::SystemInfo prepare_sheet() {
    mesh = sheet_mesh(31, 21);
    for (Vec3& p : mesh.points) p[2] *= 0.01;
    v1::Setup setup = sheet_setup(register_mesh(mesh).id());
    setup.mutable_handles(0)->mutable_region()->clear_group();
    auto* box = setup.mutable_handles(0)->mutable_region()->mutable_box();
    for (const double x : {0.45, 0.4, -1.0}) box->add_min(x);
    for (const double x : {0.55, 0.6, 1.0}) box->add_max(x);
    setup.add_fixed()->set_group("right");
    setup.clear_variables();
    for (const auto& [name, axis] : {std::pair{"along", 0}, std::pair{"up", 2}}) {
      auto* variable = setup.add_variables();
      variable->set_name(name);
      variable->set_handle("right");
      for (int k = 0; k < 3; ++k) variable->add_translate(k == axis ? 1 : 0);
    }
    return prepare(setup);
  }
  Mesh mesh;
};

std::vector<std::vector<double>> many_designs() {
  std::vector<std::vector<double>> designs;  // more than share a pass
  for (int k = 0; k < 37; ++k) designs.push_back({0.03 * k - 0.3, 0.01 * (k % 5)});
  designs[10] = {0, 0};
  return designs;
}

TEST_F(EngineFaces, EveryDesignSaysWhichOfItsFacesFlipped) {
  const auto system = prepare_sheet();
  const auto deformed = deform(request_for(system.id(), many_designs()));
  std::size_t with = 0;
  for (std::size_t k = 0; k < deformed.results.size(); ++k) {
    const v1::DesignResult& result = deformed.results[k];
    ASSERT_EQ(result.design(), k);
    ASSERT_TRUE(result.has_faces());
    EXPECT_FALSE(result.has_cells());
    const auto flipped = FlipCheck(mesh, mesh.points).flipped(deformed.points[k]);
    EXPECT_EQ(result.faces().faces(), mesh.face_count());
    EXPECT_EQ(result.faces().flipped(), flipped.size()) << k;
    ASSERT_EQ(static_cast<std::size_t>(result.faces().flipped_ids_size()), std::min<std::size_t>(100, flipped.size()));
    for (int i = 0; i < result.faces().flipped_ids_size(); ++i) {
      EXPECT_EQ(result.faces().flipped_ids(i), flipped[static_cast<std::size_t>(i)].id) << "worst first";
    }
    with += flipped.empty() ? 0 : 1;
  }
  EXPECT_GT(with, 5u);
  EXPECT_LT(with, 32u);
  EXPECT_EQ(deformed.results[10].faces().flipped(), 0u) << "moves nothing";
}

TEST_F(EngineFaces, LookingAtThemChangesNoPointAndCanBeSwitchedOff) {
  const auto system = prepare_sheet();
  auto request = request_for(system.id(), many_designs());
  const auto looked = deform(request);
  request.set_check(v1::CELL_CHECK_OFF);
  const auto plain = deform(request);
  EXPECT_EQ(looked.points, plain.points);
  for (std::size_t k = 0; k < plain.results.size(); ++k) {
    EXPECT_FALSE(plain.results[k].has_faces());
    EXPECT_EQ(plain.results[k].max_displacement(), looked.results[k].max_displacement());
    EXPECT_EQ(plain.results[k].checksum(), looked.results[k].checksum());
  }
}

TEST_F(EngineFaces, SaysWhichFacesRanIntoOthersWhereItIsAsked) {
  const auto system = prepare_sheet();
  auto request = request_for(system.id(), many_designs());
  for (const v1::DesignResult& result : deform(request).results) EXPECT_FALSE(result.faces().has_intersecting());
  request.set_intersections(true);
  const auto deformed = deform(request);
  const IntersectionCheck check(mesh, mesh.points);
  std::size_t with = 0;
  for (std::size_t k = 0; k < deformed.results.size(); ++k) {
    const v1::DesignResult& result = deformed.results[k];
    const auto faces = check.appeared(deformed.points[k]);
    ASSERT_TRUE(result.faces().has_intersecting());
    ASSERT_EQ(result.faces().intersecting(), faces.size()) << k;
    ASSERT_EQ(static_cast<std::size_t>(result.faces().intersecting_ids_size()), std::min<std::size_t>(100, faces.size()));
    for (int i = 0; i < result.faces().intersecting_ids_size(); ++i) {
      EXPECT_EQ(result.faces().intersecting_ids(i), faces[static_cast<std::size_t>(i)].face);
    }
    if (faces.empty()) continue;
    ++with;
    EXPECT_NE(result.verdict(), v1::VERDICT_GOOD);
    const std::string count =
        std::to_string(faces.size()) + " of " + std::to_string(mesh.face_count()) + " faces ran into others";
    EXPECT_THAT(result.reasons(), testing::Contains(count));
    EXPECT_THAT(result.warnings(),
                testing::Contains(testing::HasSubstr(count + ", the first is face " + std::to_string(faces[0].face))));
  }
  EXPECT_GT(with, 2u);
  EXPECT_LT(with, 32u);
  request.set_check(v1::CELL_CHECK_OFF);
  for (const v1::DesignResult& result : deform(request).results) EXPECT_FALSE(result.has_faces());
  // Among the measures, all that intersect others.
  request.set_check(v1::CELL_QUALITY);
  const auto measured = deform(request);
  for (std::size_t k = 0; k < measured.results.size(); ++k) {
    const auto& measures = measured.results[k].quality().measures();
    const auto row =
        std::find_if(measures.begin(), measures.end(), [](const auto& m) { return m.name() == "intersecting_faces"; });
    ASSERT_NE(row, measures.end());
    EXPECT_EQ(row->value(), static_cast<double>(check.at(measured.points[k]).size()));
  }
}

TEST_F(EngineFaces, TheLargestDisplacementIsThatOfAllPointsInEveryEncoding) {
  const auto system = prepare_sheet();
  for (const v1::Encoding encoding : {v1::RAW_F64, v1::RAW_F32, v1::DRACO, v1::DELTA_ZSTD}) {
    const auto exact = deform(request_for(system.id(), many_designs()));
    const auto deformed = deform(request_for(system.id(), many_designs(), encoding));
    for (std::size_t k = 0; k < deformed.results.size(); ++k) {
      const Extreme largest = largest_displacement(exact.points[k], mesh.points);
      EXPECT_EQ(deformed.results[k].max_displacement(), largest.value) << k << " " << encoding;
    }
  }
}

TEST_F(EngineFaces, WarnsWhenAPointMovesMuchFartherThanAnyWasTold) {
  // The left end of a sheet of which only the middle is held turns like a lever.
  const Mesh lever = sheet_mesh(31, 11);
  v1::Setup setup = sheet_setup(register_mesh(lever).id());
  setup.clear_fixed();
  setup.mutable_handles(0)->mutable_region()->clear_group();
  auto* box = setup.mutable_handles(0)->mutable_region()->mutable_box();
  for (const double x : {0.8, -1.0, -1.0}) box->add_min(x);
  for (const double x : {1.1, 2.0, 1.0}) box->add_max(x);
  const auto system = prepare(setup);
  const auto deformed = deform(request_for(system.id(), {{0.1, 0}, {0, 0.2}, {0, 0}}));
  EXPECT_NEAR(deformed.results[0].prescribed_displacement(), 0.1, 1e-15);
  EXPECT_NEAR(deformed.results[0].max_displacement(), 0.1, 1e-6) << "all go along";
  EXPECT_EQ(deformed.results[0].warnings_size(), 0);
  const v1::DesignResult& turned = deformed.results[1];
  const Extreme largest = largest_displacement(deformed.points[1], lever.points);
  EXPECT_EQ(turned.max_displacement(), largest.value);
  EXPECT_NEAR(turned.prescribed_displacement(), 2 * std::sin(0.1) * 0.2, 0.01);
  ASSERT_GT(turned.max_displacement(), 3 * turned.prescribed_displacement());
  ASSERT_EQ(turned.warnings_size(), 1);
  EXPECT_NE(turned.warnings(0).find("point " + std::to_string(largest.id) + " moves "), std::string::npos) << turned.warnings(0);
  EXPECT_NE(turned.warnings(0).find("times the largest prescribed displacement"), std::string::npos) << turned.warnings(0);
  EXPECT_NE(turned.warnings(0).find("nothing is fixed"), std::string::npos) << turned.warnings(0);
  EXPECT_EQ(turned.faces().flipped(), 0u);
  EXPECT_EQ(deformed.results[2].max_displacement(), 0);
  EXPECT_EQ(deformed.results[2].warnings_size(), 0);
}

TEST_F(EngineFaces, DerivativesHaveNoDisplacement) {
  v1::JacobianVectorRequest request;
  request.set_system_id(prepare_sheet().id());
  for (const double x : {1.0, 0.0}) request.add_direction(x);
  const auto derivative = jacobian_vector(request);
  ASSERT_EQ(derivative.results.size(), 1u);
  EXPECT_GT(derivative.points[0][15][0] + derivative.points[0][325][0], 0);
  const v1::DesignResult& result = derivative.results[0];
  EXPECT_EQ(result.max_displacement(), 0);
  EXPECT_EQ(result.prescribed_displacement(), 0);
  EXPECT_FALSE(result.has_faces());
  EXPECT_EQ(result.warnings_size(), 0);
}

TEST_F(EngineFaces, BoundaryFacesOfVolumesAreLookedAtAsTheyAreDelivered) {
  const Mesh cube = volume_mesh(8);
  const auto system = prepare(block_setup_message(register_mesh(cube).id(), 3));
  const auto deformed = deform(request_for(system.id(), {{0.3, 0}, {0, 0.9}}));
  for (std::size_t k = 0; k < 2; ++k) {
    ASSERT_TRUE(deformed.results[k].has_cells());
    EXPECT_EQ(deformed.results[k].faces().faces(), cube.face_count());
    EXPECT_EQ(deformed.results[k].faces().flipped(), 0u) << "the boundary is held";
    EXPECT_EQ(deformed.results[k].max_displacement(), largest_displacement(deformed.points[k], cube.points).value);
  }
  const Mesh plane = test::square(20);
  const auto flat = prepare(block_setup_message(register_mesh(plane).id(), 2));
  auto request = request_for(flat.id(), {{0, 0.9}});
  const auto whole = deform(request);
  EXPECT_GT(whole.results[0].cells().inverted(), 0u);
  EXPECT_GT(whole.results[0].faces().flipped(), 0u) << "in a plane both say the same";
  request.mutable_splitting()->set_mode(v1::SPLIT_UNIFORM);
  request.mutable_splitting()->set_most_steps(3);
  const auto split = deform(request);
  EXPECT_EQ(split.results[0].faces().flipped(), 0u) << "of the points that are delivered";
  EXPECT_EQ(split.results[0].max_displacement(), largest_displacement(split.points[0], plane.points).value);
  EXPECT_NEAR(split.results[0].prescribed_displacement(), 0.9, 1e-12);
}

TEST_F(EngineFaces, MemoryIsGivenBackAndWhereItIsShortFewerDesignsShareAPass) {
  const auto system = prepare_sheet();
  deform(request_for(system.id(), {{0.1, 0}}));  // makes the check that is kept
  const std::size_t before = engine->info().memory_in_use();
  deform(request_for(system.id(), many_designs()));
  EXPECT_TRUE(eventually([&] { return engine->info().memory_in_use() <= before; }));

  StepPlan plan{1'000'000, 30'000, 40};
  EXPECT_EQ(plan.group(), 16u);
  plan.looks = StepPlan::Looks::after_blocks;
  EXPECT_EQ(plan.group(), 11u) << "256 MiB";
  EXPECT_EQ(plan.open_groups(2), 2u);
  const std::size_t all = plan.buffer_bytes(2);
  plan.most_designs = 1;
  EXPECT_EQ(plan.group(), 1u);
  EXPECT_LT(plan.buffer_bytes(2), all / 8);
  EXPECT_EQ(StepPlan({1000, 30'000, 400, StepPlan::Looks::after_blocks}).open_groups(8), 9u)
      << "a block each, and all workers busy";
  EXPECT_EQ(StepPlan({1000, 30'000, 5, StepPlan::Looks::after_blocks}).open_groups(8), 1u);
}

}  // namespace
}  // namespace deform::server::engine_faces_test
