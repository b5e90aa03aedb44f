// SPDX-License-Identifier: GPL-3.0-or-later
// Volume meshes through the engine: cells are stored with their geometry, designs are checked, measured and split.
#include <algorithm>

#include "core/deformers/splitting.h"
#include "core/quality/element_quality.h"
#include "proto/convert/setup.h"
#include "server/store/geometry_file.h"
#include "tests/server/engine_fixture.h"
#include "tests/server/volume_mesh.h"
#include "tests/support/expect_error.h"

namespace deform::server::engine_cells_test {
namespace {

class EngineCells : public EngineFixture {
 protected:
  struct Prepared {
    Mesh mesh;
    v1::SystemInfo system;
    deform::Setup setup;
  };
  Prepared prepare_mesh(Mesh mesh, int dimensions) {
    Prepared prepared;
    prepared.mesh = std::move(mesh);
    const auto info = register_mesh(prepared.mesh);
    EXPECT_EQ(info.cells(), prepared.mesh.cell_count());
    prepared.system = prepare(block_setup_message(info.id(), dimensions));
    prepared.setup = convert::setup_from_proto(prepared.system.setup(), 100);
    return prepared;
  }
  static MotionSafety expected(const Prepared& prepared, const Points& points) {
    return safe_amplitude(prepared.mesh.points, points, *cell_set(prepared.mesh));
  }
};

void expect_report(const v1::CellReport& report, const MotionSafety& safety) {
  EXPECT_EQ(report.safe_amplitude(), safety.amplitude);
  EXPECT_EQ(report.inverted(), safety.inverted.count);
  ASSERT_EQ(static_cast<std::size_t>(report.inverted_ids_size()), safety.inverted.worst.size());
  for (std::size_t k = 0; k < safety.inverted.worst.size(); ++k) {
    EXPECT_EQ(report.inverted_ids(static_cast<int>(k)), safety.inverted.worst[k].id);
  }
  EXPECT_EQ(report.has_first_cell(), safety.first_cell.has_value());
  EXPECT_EQ(report.first_cell(), safety.first_cell.value_or(0));
  EXPECT_EQ(report.least_determinant(), safety.inverted.least_determinant.value);
}

TEST_F(EngineCells, EveryDesignIsCheckedForItself) {
  for (const bool by_faces : {false, true}) {
    const Prepared prepared = prepare_mesh(by_faces ? polyhedral_mesh(10) : volume_mesh(10), 3);
    std::vector<std::vector<double>> designs;
    for (int k = 0; k < 20; ++k) designs.push_back({0.1 * k, 0.02 * k});  // more than share a pass
    const auto deformed = deform(request_for(prepared.system.id(), designs));
    std::size_t inverted = 0;
    for (std::size_t k = 0; k < designs.size(); ++k) {
      ASSERT_TRUE(deformed.results[k].has_cells());
      EXPECT_FALSE(deformed.results[k].has_quality());
      EXPECT_EQ(deformed.results[k].cells().cells(), 1000u);
      expect_report(deformed.results[k].cells(), expected(prepared, deformed.points[k]));
      inverted += deformed.results[k].cells().inverted() > 0 ? 1 : 0;
    }
    EXPECT_GT(inverted, 3u);
    EXPECT_LT(inverted, 17u);
  }
}

/// As many fields of zeros as wanted.
class NoFields : public DisplacementFields {
 public:
  explicit NoFields(std::size_t count) : count_(count) {}
  std::size_t count() const override { return count_; }
  void values(std::size_t, std::size_t, std::span<double> values, const RunContext&) const override {
    std::fill(values.begin(), values.end(), 0.0);
  }
  double error(std::size_t) const override { return 0; }

 private:
  std::size_t count_;
};

// Fields of the basis save time and are done without where memory is short.
TEST(CellCheckCache, TakesTheFieldsThatTheBudgetAllows) {
  const Mesh mesh = volume_mesh(10);
  const CellSet cells = *cell_set(mesh);
  const std::size_t points = mesh.point_count(), without = InversionCheck::bytes_to_make(cells, points);
  const NoFields few(4), many(4000);
  const auto fields_of_check = [&](const NoFields& fields, std::size_t budget) {
    MemoryBudget memory(budget);
    const CellCheckCache cache;
    const std::size_t found = cache.get(mesh, cells, &fields, memory, {})->fields();
    EXPECT_EQ(cache.get(mesh, cells, &fields, memory, {})->fields(), found) << "kept";
    EXPECT_EQ(memory.in_use(), InversionCheck::bytes_for(cells, points, found));
    return found;
  };
  EXPECT_EQ(fields_of_check(few, 2 * without), 4u);
  EXPECT_EQ(fields_of_check(many, 2 * without), 0u);
  MemoryBudget none(without / 2);
  const CellCheckCache cache;
  test::expect_error(ErrorCode::out_of_budget, {"checking the cells"}, [&] { cache.get(mesh, cells, &few, none, {}); });
}

TEST_F(EngineCells, CheckingChangesNoPoint) {
  const Prepared prepared = prepare_mesh(volume_mesh(10), 3);
  auto request = request_for(prepared.system.id(), {{0.3, 0}, {0, 0.9}, {2.5, 0.1}});
  const auto checked = deform(request);
  request.set_check(v1::CELL_CHECK_OFF);
  const auto plain = deform(request);
  EXPECT_EQ(checked.points, plain.points);
  for (const auto& result : plain.results) EXPECT_FALSE(result.has_cells() || result.has_quality() || result.has_split());
}

TEST_F(EngineCells, CellsSurviveARestart) {
  const Prepared prepared = prepare_mesh(polyhedral_mesh(6), 3);
  const auto request = request_for(prepared.system.id(), {{0, 0.9}});
  const auto before = deform(request);
  reopen();
  const auto after = deform(request);
  EXPECT_EQ(after.points, before.points);
  EXPECT_EQ(after.results[0].cells().SerializeAsString(), before.results[0].cells().SerializeAsString());
  EXPECT_GT(after.results[0].cells().inverted(), 0u);
}

TEST_F(EngineCells, QualityIsThatOfTheDeformedMesh) {
  const Prepared prepared = prepare_mesh(volume_mesh(8), 3);
  auto request = request_for(prepared.system.id(), {{0, 0}, {0.2, 0.1}});
  request.set_check(v1::CELL_QUALITY);
  const auto deformed = deform(request);
  for (std::size_t k = 0; k < 2; ++k) {
    const auto& quality = deformed.results[k].quality();
    const auto found = std::find_if(quality.measures().begin(), quality.measures().end(),
                                    [](const auto& measure) { return measure.name() == "scaled_jacobian"; });
    ASSERT_NE(found, quality.measures().end());
    EXPECT_EQ(found->value(), element_quality(deformed.points[k], *prepared.mesh.elements).least_scaled_jacobian.value);
    EXPECT_GT(quality.histograms_size(), 0);
    EXPECT_TRUE(deformed.results[k].has_cells());
  }
}

TEST_F(EngineCells, QualityOfASurface) {
  const auto geometry = register_mesh(sheet_mesh(12, 9));
  const auto system = prepare(sheet_setup(geometry.id()));
  auto request = request_for(system.id(), {{0.2, 0.1}});
  EXPECT_FALSE(deform(request).results[0].has_cells());
  request.set_check(v1::CELL_QUALITY);
  const auto deformed = deform(request);
  EXPECT_FALSE(deformed.results[0].has_cells());
  EXPECT_GT(deformed.results[0].quality().measures_size(), 0);
}

TEST_F(EngineCells, FacesOfAPlaneMeshAreItsCells) {
  const Prepared prepared = prepare_mesh(test::square(20), 2);
  const auto deformed = deform(request_for(prepared.system.id(), {{0, 0.1}, {0, 0.9}}));
  EXPECT_EQ(deformed.results[0].cells().safe_amplitude(), 1);
  EXPECT_EQ(deformed.results[0].cells().cells(), 400u);
  EXPECT_GT(deformed.results[1].cells().inverted(), 0u);
  expect_report(deformed.results[1].cells(), expected(prepared, deformed.points[1]));
}

TEST_F(EngineCells, OnlyDesignsThatNeedItAreSplit) {
  const Prepared prepared = prepare_mesh(test::square(30), 2);
  auto request = request_for(prepared.system.id(), {{0.5, 0}, {2.3, 0}, {0, 0.9}});
  const auto plain = deform(request);
  request.mutable_splitting()->set_mode(v1::SPLIT_UNIFORM);
  request.mutable_splitting()->set_most_steps(5);
  const auto split = deform(request);
  EXPECT_EQ(split.points[0], plain.points[0]);
  EXPECT_EQ(split.results[0].split().steps(), 1u);
  EXPECT_TRUE(split.results[0].split().inversion_free());

  SplitProblem problem;
  problem.mesh = std::make_shared<const Mesh>(prepared.mesh);
  problem.setup = prepared.setup;
  problem.cells = problem.mesh.get();
  Design turned;
  turned.variables = {2.3, 0};
  SplitOptions split_options;
  split_options.most_steps = 5;
  const SplitResult expected_points = evaluate_split(problem, turned, split_options);
  EXPECT_TRUE(split.results[1].split().inversion_free());
  EXPECT_EQ(split.results[1].split().steps(), expected_points.steps);
  EXPECT_GT(expected_points.steps, 1u);
  EXPECT_EQ(split.results[1].split().reached(), 1);
  EXPECT_EQ(split.points[1], expected_points.points);
  EXPECT_GT(split.results[1].cells().inverted(), 0u) << "of the full step";
  const CellSet cells = problem.mesh.get();
  EXPECT_EQ(InversionCheck(problem.mesh->points, cells).inverted(split.points[1]).count, 0u);

  // Through the side: nothing helps.
  EXPECT_FALSE(split.results[2].split().inversion_free());
  EXPECT_LT(split.results[2].split().reached(), 1);
  EXPECT_GE(split.results[2].split().reached(), (1 - 1e-9) * split.results[2].cells().safe_amplitude());
  const Inversions inversions = InversionCheck(problem.mesh->points, cells).inverted(split.points[2]);
  EXPECT_EQ(inversions.count, 0u);
  EXPECT_EQ(split.results[2].split().least_determinant(), inversions.least_determinant.value);

  // A margin is kept, by designs that invert nothing, too.
  const double least = plain.results[0].cells().least_determinant();
  request.mutable_splitting()->set_margin(std::min(0.9, 1.02 * least));
  const auto kept = deform(request);
  for (const auto& result : kept.results) EXPECT_GE(result.split().least_determinant(), request.splitting().margin());
  EXPECT_NE(kept.points[0], plain.points[0]);
}

TEST_F(EngineCells, LeftHandedMeshesAreProtected) {
  const Mesh right = polyhedral_mesh(6), left = [&] {
    Mesh mirrored = right;
    for (Vec3& p : mirrored.points) p[0] = 1 - p[0];
    return mirrored;
  }();
  const auto report_of = [&](const Mesh& mesh) {
    return deform(request_for(prepare_mesh(mesh, 3).system.id(), {{0, 0.9}})).results[0].cells();
  };
  const v1::CellReport a = report_of(right), b = report_of(left);
  EXPECT_EQ(a.left_handed(), 0u);
  EXPECT_EQ(b.left_handed(), 216u);
  EXPECT_EQ(b.inverted_at_rest(), 0u);
  EXPECT_GT(b.inverted(), 0u);
  for (const auto& report : {a, b}) EXPECT_EQ(report.without_volume() + report.wrong_pyramid(), report.inverted());
}

TEST_F(EngineCells, RefusesWhatCannotBeSplitOrIsUnknown) {
  const auto system = prepare(sheet_setup(register_mesh(sheet_mesh(12, 9)).id()));
  auto request = request_for(system.id(), {{0.2, 0.1}});
  request.mutable_splitting()->set_mode(v1::SPLIT_ADAPTIVE);
  test::expect_error(ErrorCode::failed_precondition, {"splitting", "no cells"}, [&] { deform(request); });
  request.mutable_splitting()->set_most_steps(1001);
  test::expect_error(ErrorCode::invalid_argument, {"splitting.most_steps", "1000"}, [&] { deform(request); });
  request.mutable_splitting()->set_most_steps(0);
  request.mutable_splitting()->set_share(1);
  test::expect_error(ErrorCode::invalid_argument, {"splitting.share"}, [&] { deform(request); });
  request.mutable_splitting()->set_share(0);
  request.mutable_splitting()->set_margin(1);
  test::expect_error(ErrorCode::invalid_argument, {"splitting.margin"}, [&] { deform(request); });
  request.clear_splitting();
  request.set_check(static_cast<v1::CellCheck>(77));
  test::expect_error(ErrorCode::invalid_argument, {"check", "77"}, [&] { deform(request); });
}

TEST_F(EngineCells, MemoryOfChecksIsChargedAndGivenBack) {
  const Prepared prepared = prepare_mesh(volume_mesh(10), 3);
  deform(request_for(prepared.system.id(), {{0.1, 0}}));  // makes the check that is kept
  const std::size_t before = engine->info().memory_in_use();
  auto request = request_for(prepared.system.id(), {{2.3, 0}, {0, 0.5}});
  request.set_check(v1::CELL_QUALITY);
  request.mutable_splitting()->set_mode(v1::SPLIT_ADAPTIVE);
  deform(request);
  EXPECT_TRUE(eventually([&] { return engine->info().memory_in_use() <= before; }))
      << before << " before, " << engine->info().memory_in_use() << " now";
}

TEST_F(EngineCells, CellsAreChecksummed) {
  const Mesh mesh = volume_mesh(3), other = polyhedral_mesh(3);
  Mesh surface = mesh;
  surface.elements = nullptr;
  EXPECT_NE(mesh_id(mesh), mesh_id(surface));
  EXPECT_NE(mesh_id(mesh), mesh_id(other));
  auto changed = std::make_shared<Elements>(*mesh.elements);
  std::swap(changed->points[0], changed->points[1]);
  Mesh swapped = mesh;
  swapped.elements = changed;
  EXPECT_NE(mesh_id(mesh), mesh_id(swapped));
}

}  // namespace
}  // namespace deform::server::engine_cells_test
