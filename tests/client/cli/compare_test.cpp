// SPDX-License-Identifier: GPL-3.0-or-later
// Which methods are compared, what is measured of a design, and what the tables say.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "client/cli/compare/compared.h"
#include "client/cli/compare/compared_output.h"
#include "client/cli/compare/compared_table.h"
#include "client/cli/setup/reading.h"
#include "core/base/vectors.h"
#include "core/mesh/ahmed.h"
#include "tests/support/expect_error.h"

namespace deform::cli::compare_test {
namespace {

using test::expect_error;
using testing::ElementsAre;
using testing::HasSubstr;

v1::Setup parsed(const std::string& text) {
  v1::Setup setup;
  parse_yaml(text, "setup.yaml", setup);
  return setup;
}

class MethodChoices : public testing::Test {
 protected:
  MethodChoices() { std::filesystem::create_directories(folder_); }
  ~MethodChoices() override { std::filesystem::remove_all(folder_); }
  std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name) << text;
    return folder_ / name;
  }
  const std::filesystem::path folder_ = std::filesystem::temp_directory_path() / ("deform-methods-" + std::to_string(getpid()));
};

std::vector<std::string> labels(const std::vector<MethodChoice>& choices) {
  std::vector<std::string> all;
  for (const auto& choice : choices) all.push_back(choice.label);
  return all;
}

TEST_F(MethodChoices, WithoutNamesAreThatOfTheSetupAndTheOthersWithDefaults) {
  const v1::Setup setup = parsed("method: {subspace: {centres: 77}}");
  const auto choices = method_choices({}, setup);
  EXPECT_THAT(labels(choices), ElementsAre("subspace", "rbf", "shell", "mls", "ffd"));
  EXPECT_EQ(choices[0].source, "the setup");
  EXPECT_EQ(choices[0].method.subspace().centres(), 77u);
  EXPECT_EQ(choices[3].source, "defaults");
  EXPECT_EQ(choices[3].method.SerializeAsString(), parsed("method: {mls: {}}").method().SerializeAsString());
  EXPECT_THAT(labels(method_choices({}, parsed("geometry: a"))), ElementsAre("rbf", "shell", "subspace", "mls", "ffd"));
}

TEST_F(MethodChoices, TakeTheBlockOfTheSetupForItsOwnMethodOnly) {
  const v1::Setup setup = parsed("method: {shell: {energy: {stretching: 3}}}");
  const auto choices = method_choices({"mls", "shell"}, setup);
  EXPECT_EQ(choices[1].method.shell().energy().stretching(), 3);
  EXPECT_FALSE(choices[0].method.mls().has_energy());
  EXPECT_TRUE(choices[0].method.has_mls());
}

TEST_F(MethodChoices, MayBeFiles) {
  write("box.off", "OFF\n4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n");
  const auto choices = method_choices(
      {write("fine.yaml", "method: {ffd: {lattice: {points: [9, 8, 7]}}}"), write("box.yaml", "method: {cage: {file: box.off}}")},
      parsed("geometry: a"));
  EXPECT_THAT(labels(choices), ElementsAre("fine", "box"));
  EXPECT_EQ(choices[0].kind, "ffd");
  EXPECT_EQ(choices[0].method.ffd().lattice().points(2), 7u);
  EXPECT_EQ(choices[1].method.cage().vertices_size(), 12) << "the mesh is looked for beside the file";
}

TEST_F(MethodChoices, MayGenerateCagesAroundTheMesh) {
  const std::string file = write("around.yaml", "method: {cage: {generate: {kind: BOX, points: 60}, control: MESH}}");
  const auto mesh = std::make_shared<const Mesh>(ahmed_body({.target_points = 2000}));
  const auto choices = method_choices({file}, parsed("geometry: a"), mesh);
  EXPECT_GT(choices.at(0).method.cage().vertices_size(), 3 * 40);
  expect_error(ErrorCode::invalid_argument, {"around.yaml", "generate"}, [&] { method_choices({file}, parsed("geometry: a")); });
}

TEST_F(MethodChoices, AreRefusedByName) {
  const v1::Setup setup = parsed("geometry: a");
  const auto refused = [&](const std::vector<std::string>& names, const std::vector<const char*>& parts) {
    expect_error(ErrorCode::invalid_argument, parts, [&] { method_choices(names, setup); });
  };
  refused({"shel"}, {"--methods shel", "neither a file", "did you mean \"shell\""});
  refused({"rbf", "rbf"}, {"\"rbf\"", "twice"});
  refused({write("rbf.yaml", "method: {rbf: {}}"), "rbf"}, {"\"rbf\"", "twice"});
  refused({write("more.yaml", "method: {rbf: {}}\nfixed: [{all: true}]")}, {"more.yaml", "fixed", "unexpected"});
  refused({write("none.yaml", "seed: 0\nmethod: {}")}, {"none.yaml", "method", "missing"});
}

// ---- measuring ----

/// A sheet of 9 x 9 points over [0, 8]^2 and its setup: one side moves, the other stays.
constexpr char sheet_setup[] =
    "handles: [{name: end, region: {box: {min: [7, -1, -1], max: [9, 9, 1]}}}]\n"
    "fixed: [{box: {min: [-1, -1, -1], max: [1, 9, 1]}}]\n"
    "variables: [{name: up, handle: end, translate: [0, 0, 2], upper: 1}, {name: turn, handle: end, rotate: {axis: [0, 1, 0], "
    "centre: [8, 0, 0], unit: DEGREES}}]\n";

std::unique_ptr<io::MeshFile> sheet(double bump) {
  std::ostringstream text;
  for (int j = 0; j < 9; ++j) {
    for (int i = 0; i < 9; ++i) text << "v " << i << ' ' << j << ' ' << bump * ((i * j) % 3) << '\n';
  }
  for (int j = 0; j < 8; ++j) {
    for (int i = 0; i < 8; ++i) {
      const int a = 1 + i + 9 * j;
      text << "f " << a << ' ' << a + 1 << ' ' << a + 10 << ' ' << a + 9 << '\n';
    }
  }
  return io::parse_mesh(text.str(), "sheet.obj");
}

TEST(DesignMeasurer, SaysHowFarHandlesAreFromWhereTheyAreSent) {
  const auto file = sheet(0.1);
  const v1::Setup setup = parsed(sheet_setup);
  const DesignMeasurer measurer(setup, *file);
  const std::vector<double> values{0.5, 90};
  Points points = file->mesh()->points;
  for (Vec3& p : points) {
    if (p[0] < 7) continue;
    p[2] += 1;  // up, then a quarter turn: z to x
    p = {8 + p[2], p[1], -(p[0] - 8)};
  }
  const auto exact = measurer.measured({}, Points(points), values, DesignMeasurer::Keep::nothing);
  ASSERT_TRUE(exact.misfit);
  EXPECT_LT(exact.misfit->largest, 1e-14);
  points[9 * 3 + 7][1] += 0.25;  // of the handle
  points[9 * 2 + 1][2] -= 0.5;   // of the fixed region
  points[9 * 4 + 4][2] += 9;     // of neither
  const auto off = measurer.measured({}, Points(points), values, DesignMeasurer::Keep::nothing);
  EXPECT_NEAR(off.misfit->largest, 0.5, 1e-14);
  EXPECT_EQ(off.misfit->point, 9u * 2 + 1);
  EXPECT_NEAR(off.misfit->rms, std::sqrt((0.25 * 0.25 + 0.5 * 0.5) / 36), 1e-14);
  EXPECT_TRUE(off.points.empty());
  expect_error(ErrorCode::invalid_argument, {"\"up\"", "bounds"}, [&] {
    measurer.measured({}, Points(points), std::vector<double>{2, 0}, DesignMeasurer::Keep::nothing);
  });
}

TEST(DesignMeasurer, KeepsWhatPicturesNeedAndKnowsMeasuresAtRest) {
  const auto file = sheet(0.1);
  const v1::Setup setup = parsed(sheet_setup);
  const DesignMeasurer measurer(setup, *file);
  ASSERT_EQ(measurer.measures().size(), 2u);
  EXPECT_EQ(measurer.measures()[0].name, "least_angle");
  EXPECT_GT(measurer.measures()[0].at_rest, 60);
  v1::DesignResult result;
  auto& measure = *result.mutable_quality()->add_measures();
  measure.set_name("least_angle");
  measure.set_value(12.5);
  const std::vector<double> rest{0, 0};
  const auto still = measurer.measured(result, Points(file->mesh()->points), rest, DesignMeasurer::Keep::pictures);
  EXPECT_EQ(still.measures[0], 12.5);
  EXPECT_TRUE(std::isnan(still.measures[1])) << "the server did not say";
  EXPECT_EQ(still.points, file->mesh()->points);
  EXPECT_EQ(still.smoothness->high_pass_energy, 0);
  EXPECT_EQ(still.smoothness->border_kink, 0);
  Points folded = file->mesh()->points;
  for (Vec3& p : folded) {
    if (p[0] >= 7) p[2] += p[0] - 7;  // by 45 degrees
  }
  const auto kinked = measurer.measured(result, std::move(folded), rest, DesignMeasurer::Keep::pictures);
  EXPECT_GT(kinked.smoothness->border_kink, 30);
  EXPECT_GT(kinked.smoothness->high_pass_energy, 0.01);
  EXPECT_EQ(kinked.flipped.size(), 64u);
}

TEST(DesignMeasurer, ShowsPatchesWithHandlesOfVolumeMeshesOnly) {
  const auto cubes = io::parse_mesh(
      "MeshVersionFormatted 2\nDimension 3\nVertices 8\n0 0 0 0\n1 0 0 0\n1 1 0 0\n0 1 0 0\n0 0 1 0\n1 0 1 0\n1 1 1 0\n0 1 1 0\n"
      "Quadrilaterals 2\n1 4 3 2 5\n5 6 7 8 6\nHexahedra 1\n1 2 3 4 5 6 7 8 1\nEnd\n",
      "cube.mesh");
  const Mesh& mesh = *cubes->mesh();
  const auto hidden =
      faces_without_handles(parsed("handles: [{name: top, region: {box: {min: [0, 0, 1], max: [1, 1, 1]}}}]"), mesh);
  ASSERT_EQ(hidden.size(), mesh.face_count());
  for (const Group& group : mesh.groups) {
    for (const FaceId f : group.faces) {
      std::vector<PointId> corners;
      const auto offsets = mesh.face_offsets();
      const bool top = std::all_of(mesh.face_points.begin() + static_cast<long>(offsets[f]),
                                   mesh.face_points.begin() + static_cast<long>(offsets[f + 1]),
                                   [&](PointId p) { return mesh.points[p][2] == 1; });
      EXPECT_EQ(hidden[f], top ? 0 : 1);
    }
  }
  EXPECT_TRUE(faces_without_handles(parsed("handles: [{name: a, region: {ids: [0]}}]"), mesh).empty()) << "none would be left";
  EXPECT_TRUE(faces_without_handles(parsed(sheet_setup), *sheet(0.1)->mesh()).empty());
}

// ---- tables ----

ComparedDesign design_with(v1::Verdict verdict, double misfit, std::uint64_t flipped) {
  ComparedDesign design;
  design.result.set_verdict(verdict);
  design.result.mutable_faces()->set_flipped(flipped);
  design.misfit = Misfit{misfit, misfit, 0};
  return design;
}

MethodComparison three_methods() {
  MethodComparison comparison;
  comparison.setup = "car.yaml";
  comparison.mesh = std::make_shared<const Mesh>();
  comparison.designs = {"wide"};
  comparison.values = {"a = 1"};
  comparison.methods = {{{"rbf", "rbf", "the setup", {}}, {}, {}, 7, 0.5, {design_with(v1::VERDICT_GOOD, 1e-9, 0)}},
                        {{"fine", "ffd", "fine.yaml", {}}, {}, {}, 7, 0.5, {design_with(v1::VERDICT_BAD, 0.25, 3)}},
                        {{"shell", "shell", "defaults", {}}, {"no faces", "no edges"}, {}, 0, 0, {}}};
  comparison.methods[1].designs[0].result.add_reasons("3 faces are flipped");
  return comparison;
}

TEST(ComparisonTables, MarkWhatIsBestAndWhatIsWrong) {
  const auto table = design_table(three_methods(), 0);
  EXPECT_THAT(table.columns, ElementsAre("verdict", "misfit at handles", "largest displacement", "flipped faces"));
  ASSERT_EQ(table.rows.size(), 3u) << "at rest, and two that are not refused";
  EXPECT_EQ(table.rows[1].cells[1].mark, ComparisonPage::Mark::none) << "the only one that may be used";
  EXPECT_EQ(table.rows[2].cells[1].mark, ComparisonPage::Mark::none);
  EXPECT_EQ(table.rows[2].cells[3].mark, ComparisonPage::Mark::bad);
  EXPECT_EQ(table.rows[2].cells[3].text, "3");
  EXPECT_EQ(table.rows[1].cells[2].mark, ComparisonPage::Mark::none) << "a displacement is neither good nor bad";
  EXPECT_THAT(design_remarks(three_methods(), 0), ElementsAre("fine: 3 faces are flipped"));
}

TEST(ComparisonTables, DoNotCallABadDesignTheBest) {
  MethodComparison comparison = three_methods();
  comparison.methods[1].designs[0].misfit->largest = 1e-12;  // the best of all, but bad
  comparison.methods[2] = comparison.methods[0];
  comparison.methods[2].designs[0].misfit->largest = 0.5;
  const auto table = design_table(comparison, 0);
  EXPECT_EQ(table.rows[1].cells[1].mark, ComparisonPage::Mark::good) << "the best of those that may be used";
  EXPECT_EQ(table.rows[2].cells[1].mark, ComparisonPage::Mark::none);
  EXPECT_EQ(table.rows[2].cells[3].mark, ComparisonPage::Mark::bad) << "what is wrong stays marked";
  EXPECT_EQ(table.rows[3].cells[1].mark, ComparisonPage::Mark::none);
}

TEST(ComparisonTables, HaveRefusalsAsRows) {
  const auto table = methods_table(three_methods());
  ASSERT_EQ(table.rows.size(), 3u);
  EXPECT_THAT(table.rows[2].refusals, ElementsAre("no faces", "no edges"));
  EXPECT_EQ(table.rows[1].method, "fine (ffd)");
  EXPECT_EQ(table.rows[1].cells.back().text, "bad");
  std::ostringstream out;
  print_comparison(three_methods(), out);
  EXPECT_THAT(out.str(), HasSubstr("refused: no faces; no edges\n"));
  EXPECT_THAT(out.str(), HasSubstr("\nwide: a = 1\n"));
  const auto json = comparison_json(three_methods());
  EXPECT_EQ(json["methods"][2]["refused"], (std::vector<std::string>{"no faces", "no edges"}));
  EXPECT_EQ(json["methods"][1]["designs"][0]["flipped_faces"], 3);
  EXPECT_EQ(json["methods"][0]["designs"][0]["misfit"]["largest"], 1e-9);
}

TEST(ComparisonTables, HaveDesignsThatFailed) {
  MethodComparison comparison = three_methods();
  comparison.methods[1].designs[0] = {};
  comparison.methods[1].designs[0].error = "handles contradict each other";
  EXPECT_FALSE(comparison.methods[1].works());
  EXPECT_TRUE(comparison.methods[0].works());
  EXPECT_THAT(design_table(comparison, 0).rows[2].refusals, ElementsAre("handles contradict each other"));
  EXPECT_EQ(methods_table(comparison).rows[1].cells.back().text, "failed");
  EXPECT_EQ(comparison_json(comparison)["methods"][1]["designs"][0]["error"], "handles contradict each other");
}

}  // namespace
}  // namespace deform::cli::compare_test
