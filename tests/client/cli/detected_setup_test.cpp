// SPDX-License-Identifier: GPL-3.0-or-later
// What `deform detect` writes, read back as the other commands read it.
#include "client/cli/output/detected_setup.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <unistd.h>

#include <filesystem>

#include "client/cli/setup/reading.h"
#include "core/io/mesh_file.h"
#include "tests/support/expect_error.h"

namespace deform::cli::detected_setup_test {
namespace {

using test::expect_error;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

class DetectedSetups : public testing::Test {
 protected:
  DetectedSetups() {
    const auto* info = testing::UnitTest::GetInstance()->current_test_info();
    folder_ = std::filesystem::temp_directory_path() / (std::string("deform_") + info->name() + std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
  }
  ~DetectedSetups() override { std::filesystem::remove_all(folder_); }

  std::filesystem::path write(const std::string& name, const std::string& text) const {
    io::write_file(folder_ / name, text);
    return folder_ / name;
  }

  void plane(const std::string& name, std::vector<PointId> points, const std::string& constraint = "planar") {
    auto& primitive = detected_.primitives.emplace_back();
    primitive.about.set_name(name);
    primitive.about.set_kind(v1::PRIMITIVE_PLANE);
    primitive.about.set_constraint(constraint);
    primitive.points = std::move(points);
  }
  void line(const std::string& name, std::vector<PointId> points, const std::vector<std::string>& implied_by) {
    auto& edge = detected_.edges.emplace_back();
    edge.about.set_name(name);
    edge.about.set_kind(v1::EDGE_LINE);
    edge.about.set_constraint("straight");
    edge.about.mutable_implied_by()->Assign(implied_by.begin(), implied_by.end());
    edge.points = std::move(points);
  }

  /// Written, with a mesh file beside it, and read again.
  v1::Setup read_back(const DetectedSetupOptions& options) {
    detected_.summary.set_area(1);
    written_ = detected_setup(detected_, options);
    if (!written_.points.empty()) write(options.points_file, written_.points);
    write("part.obj", "v 0 0 0\n");
    return read_setup_file(write("found.yaml", written_.text)).setup;
  }

  client::Detected detected_;
  DetectedSetup written_;
  std::filesystem::path folder_;
};

std::vector<PointId> count_to(PointId count) {
  std::vector<PointId> ids;
  for (PointId i = 0; i < count; ++i) ids.push_back(3 * i);
  return ids;
}

TEST_F(DetectedSetups, LongListsStandInAFileBesideIt) {
  plane("plane_z0.3_1", count_to(1000));
  plane("plane_z0_1", {5, 6, 7, 8});
  const v1::Setup setup = read_back({"part.obj", "", "found: #1.json", {}});
  ASSERT_EQ(setup.constraints_size(), 2);
  EXPECT_EQ(setup.constraints(0).name(), "plane_z0.3_1");
  EXPECT_TRUE(setup.constraints(0).has_planar());
  const auto& ids = setup.constraints(0).regions(0).ids();
  EXPECT_EQ(std::vector<PointId>(ids.begin(), ids.end()), count_to(1000));
  EXPECT_THAT(setup.constraints(1).regions(0).ids(), ElementsAre(5, 6, 7, 8));
  EXPECT_LT(written_.text.size(), 2000u);
  EXPECT_EQ(written_.written, 2u);
  EXPECT_THAT(written_.points, Not(HasSubstr("plane_z0_1")));
}

TEST_F(DetectedSetups, MayBeKeptExactly) {
  plane("a", count_to(20));
  plane("b", count_to(21));
  line("line_l3_1", {0, 3, 6, 9}, {"a", "b"});
  DetectedSetupOptions options{"part.obj", "", "points.json", {}};
  EXPECT_FALSE(read_back(options).constraints(0).exact());
  options.kept = DetectedSetupOptions::Kept::exactly;
  read_back(options);
  std::string text = written_.text;
  text.erase(text.find("# - {name: line_l3_1"), 2);
  const v1::Setup taken = read_setup_file(write("taken.yaml", text)).setup;
  ASSERT_EQ(taken.constraints_size(), 3);
  for (const v1::Constraint& constraint : taken.constraints()) EXPECT_TRUE(constraint.exact()) << constraint.name();
}

TEST_F(DetectedSetups, WithoutSetsIsLegal) {
  const v1::Setup setup = read_back({"part.obj", "", "points.json", {}});
  EXPECT_EQ(setup.constraints_size(), 0);
  EXPECT_TRUE(written_.points.empty());
  plane("plane_x1_1", {1, 2, 3}, "");
  EXPECT_EQ(read_back({"part.obj", "", "points.json", {}}).constraints_size(), 0);
  EXPECT_THAT(written_.text, HasSubstr("# plane_x1_1: 3 points are too few"));
}

TEST_F(DetectedSetups, WhatFollowsFromOthersIsACommentThatCanBeTakenIn) {
  plane("a", count_to(20));
  plane("b", count_to(21));
  line("line_l3_1", {0, 3, 6, 9}, {"a", "b"});
  EXPECT_EQ(read_back({"part.obj", "", "points.json", {}}).constraints_size(), 2);
  EXPECT_EQ(written_.left_out, 1u);
  EXPECT_THAT(written_.text, HasSubstr("follows from a and b"));
  std::string text = written_.text;
  const std::size_t comment = text.find("# - {name: line_l3_1");
  ASSERT_NE(comment, std::string::npos);
  text.erase(comment, 2);
  const v1::Setup taken = read_setup_file(write("taken.yaml", text)).setup;
  ASSERT_EQ(taken.constraints_size(), 3);
  EXPECT_TRUE(taken.constraints(2).has_straight());
  EXPECT_THAT(taken.constraints(2).regions(0).ids(), ElementsAre(0, 3, 6, 9));
}

TEST_F(DetectedSetups, WhatHandlesHoldIsLeftOutOrMarked) {
  // Points 0 to 9: fixed, fixed, two in "top", the rest is free.
  const HeldPoints held{{1, 1, 2, 2, 0, 0, 0, 0, 0, 0}, {"top", "other"}};
  plane("fixed", {0, 1});
  plane("both", {0, 1, 2, 3});
  plane("partly", {1, 2, 3, 4, 5});
  plane("free", {4, 5, 6, 7});
  const std::string beginning = "# mine\ngeometry: part.obj\nmethod: {shell: {}}\nhandles: [{name: top, region: {ids: [2, 3]}}]";
  const v1::Setup setup = read_back({"", beginning, "points.json", held});
  ASSERT_EQ(setup.constraints_size(), 2);
  EXPECT_EQ(setup.constraints(0).name(), "partly");
  EXPECT_EQ(setup.constraints(1).name(), "free");
  EXPECT_EQ(setup.handles(0).name(), "top");
  EXPECT_TRUE(setup.method().has_shell());
  EXPECT_THAT(written_.text, HasSubstr("# 1 point fixed, 2 points in handle top: these points stay"));
  EXPECT_THAT(written_.text, HasSubstr("# all its points are fixed\n"));
  EXPECT_THAT(written_.text, HasSubstr("# all its points are 2 points fixed, 2 points in handle top\n"));
  EXPECT_TRUE(written_.text.starts_with(beginning));
}

TEST_F(DetectedSetups, SymmetryPlanesAreNoConstraints) {
  plane("side", {0, 1, 2, 3});
  plane("cut", {4, 5, 6, 7});
  DetectedSetupOptions options{"part.obj", "", "points.json", {}};
  options.in_symmetry = {{"cut", "is the symmetry plane of group middle"}};
  options.symmetry = "symmetry: [{region: {group: middle}}]  # of a half model\n";
  const v1::Setup setup = read_back(options);
  ASSERT_EQ(setup.constraints_size(), 1);
  EXPECT_EQ(setup.constraints(0).name(), "side");
  ASSERT_EQ(setup.symmetry_size(), 1);
  EXPECT_EQ(setup.symmetry(0).region().group(), "middle");
  EXPECT_THAT(written_.text, HasSubstr("# - {name: cut, planar: {}, regions: [{ids: [4, 5, 6, 7]}]}  # is the symmetry plane"));
}

TEST_F(DetectedSetups, StrangeNamesAreQuoted) {
  plane("a: {b}\n# c", {1, 2, 3, 4});
  const v1::Setup setup = read_back({"part.obj", "", "points.json", {}});
  ASSERT_EQ(setup.constraints_size(), 1);
  EXPECT_EQ(setup.constraints(0).name(), "a: {b}\n# c");
  EXPECT_EQ(yaml_text("dir/part-1.obj"), "dir/part-1.obj");
  for (const char* text : {"", "true", "1.5", "-a", "a b", "a#b", "\xc3\xa4"}) EXPECT_EQ(yaml_text(text)[0], '"') << text;
}

TEST_F(DetectedSetups, ContinueOnlyWhatTheyCan) {
  const auto refused = [&](const std::string& text, const std::vector<const char*>& parts) {
    expect_error(ErrorCode::invalid_argument, parts, [&] { continued_text(write("setup.yaml", text)); });
  };
  write("part.obj", "v 0 0 0\n");
  const std::string start = "geometry: part.obj\n";
  EXPECT_EQ(continued_text(write("setup.yaml", start + "method: {mls: {}}")), start + "method: {mls: {}}");
  refused(start, {"method", "rbf takes no constraints"});
  refused(start + "method: {rbf: {}}\n", {"method", "rbf takes no constraints"});
  write("cage.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n");
  refused(start + "method: {cage: {file: cage.obj}}\n", {"method", "cage takes no constraints"});
  refused(start + "method: {mls: {}}\nconstraints: []\n", {"constraints", "take them out"});
  refused("{geometry: part.obj, method: {mls: {}}}\n", {"block style"});
  refused("---\ngeometry: part.obj\nmethod: {mls: {}}\n", {"block style"});
}

TEST_F(DetectedSetups, IdFilesAreReadAsTheySay) {
  write("list.json", "[3, 1, 2]");
  write("sets.json",
        R"({"bore": [4, 4294967295], "none": [], "word": "x", "bad": [1, -1], "large": [4294967296], "half": [0.5]})");
  write("text.json", "[1, 2");
  write("number.json", "7");
  IdFiles files(folder_);
  EXPECT_THAT(files.ids("list.json", ""), ElementsAre(3, 1, 2));
  EXPECT_THAT(files.ids("sets.json", "bore"), ElementsAre(4, 4294967295u));
  EXPECT_THAT(files.ids("sets.json", "none"), ElementsAre());
  const auto refused = [&](const char* file, const char* set, const std::vector<const char*>& parts) {
    expect_error(ErrorCode::invalid_argument, parts, [&] { files.ids(file, set); });
  };
  refused("list.json", "bore", {"list.json", "without sets", "bore"});
  refused("sets.json", "", {"sets.json", "say which"});
  refused("sets.json", "bor", {"no set \"bor\"", "did you mean \"bore\""});
  refused("sets.json", "word", {"\"word\" is no list"});
  refused("sets.json", "bad", {"\"bad\"", "entry 1 is no point id"});
  refused("sets.json", "large", {"entry 0", "4294967295"});
  refused("sets.json", "half", {"entry 0"});
  refused("text.json", "", {"text.json", "no JSON", "byte"});
  refused("number.json", "", {"expected a list"});
  expect_error(ErrorCode::not_found, {"absent.json"}, [&] { files.ids("absent.json", ""); });
}

TEST_F(DetectedSetups, IdFilesInASetupAreErrorsWithItsLine) {
  write("part.obj", "v 0 0 0\n");
  write("ids.json", R"({"bore": [1, 2]})");
  const auto refused = [&](const std::string& ids, const std::vector<const char*>& parts) {
    const auto file = write("setup.yaml", "geometry: part.obj\nfixed:\n  - {ids: " + ids + "}\n");
    expect_error(ErrorCode::invalid_argument, parts, [&] { read_setup_file(file); });
  };
  refused("{file: ids.json, set: rim}", {"setup.yaml:3", "fixed[0].ids", "no set \"rim\""});
  refused("{file: absent.json}", {"setup.yaml:3", "fixed[0].ids", "absent.json"});
  refused("{set: bore}", {"setup.yaml:3", "file, set"});
  refused("{file: ids.json, name: bore}", {"setup.yaml:3", "file, set"});
  refused("{file: [ids.json]}", {"setup.yaml:3", "fixed[0].ids.file", "expected a text"});
}

TEST_F(DetectedSetups, ASetupTellsAllThatIsWrongWithItsText) {
  const auto file =
      write("setup.yaml",
            "geometry: nowhere.obj\nhandels: []\nfixed:\n  - {ids: [1, x, -1]}\n  - {grup: a}\n"
            "variables:\n  - {name: a, lower: low, upper: high}\nseed: -1\nhandles: [{name: top, region: {all: true}}]\n");
  Problems problems(Problems::Mode::collect);
  const SetupFile read = read_setup_file(file, problems);
  std::vector<std::string> lines;
  for (const Problem& problem : problems.list()) lines.push_back(problem.message.substr(folder_.string().size() + 12));
  EXPECT_THAT(lines, ElementsAre(HasSubstr("2: unknown key \"handels\""), HasSubstr("4: fixed[0].ids[1]"),
                                 HasSubstr("4: fixed[0].ids[2]"), HasSubstr("5: fixed[1]: unknown key \"grup\""),
                                 HasSubstr("7: variables[0].lower"), HasSubstr("7: variables[0].upper"), HasSubstr("8: seed"),
                                 HasSubstr("there is no file")));
  EXPECT_EQ(read.setup.handles(0).name(), "top") << "what stands behind is read";
  expect_error(ErrorCode::invalid_argument, {"handels"}, [&] { read_setup_file(file); });
}

}  // namespace
}  // namespace deform::cli::detected_setup_test
