// SPDX-License-Identifier: GPL-3.0-or-later
// Labels of points by the regions of a setup.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include "client/cli/setup/reading.h"
#include "client/cli/setup/region_points.h"
#include "client/cli/setup/setup_stages.h"
#include "tests/support/expect_error.h"

namespace deform::cli::region_labels_test {
namespace {

using test::expect_error;
using testing::ElementsAre;

v1::Setup setup(const std::string& text) {
  v1::Setup setup;
  parse_yaml(text, "setup.yaml", setup);
  return setup;
}

Mesh line() {
  Mesh mesh;
  for (int i = 0; i < 6; ++i) mesh.points.push_back({double(i), 0, 0});
  return mesh;
}

TEST(RegionLabels, HandlesFixedAndTheRest) {
  EXPECT_THAT(region_labels(setup("handles: [{name: a, region: {ids: [5]}}, {name: b, region: {ids: [3, 4]}}]\n"
                                  "fixed: [{ids: [0]}, {box: {min: [0.5, 0, 0], max: [1.5, 0, 0]}}]\n"),
                            line()),
              ElementsAre(1, 1, 0, 3, 3, 2));
  EXPECT_THAT(region_labels(setup("handles: [{name: a, region: {ids: [0]}}, {name: b, region: {ids: [0, 1]}}]\n"
                                  "fixed: [{ids: [1, 2]}]\n"),
                            line()),
              ElementsAre(2, 3, 1, 0, 0, 0))
      << "where regions overlap";
}

TEST(RegionLabels, OfSeveralMethods) {
  const v1::Setup two = setup(
      "handles: [{name: a, region: {ids: [5]}}]\nfixed: [{ids: [0, 1, 2]}]\n"
      "then: [{method: {shell: {}}, handles: [{name: b, region: {ids: [2]}}, {name: c, region: {ids: [5, 4]}}], fixed: [{ids: "
      "[0]}]}]\n"
      "variables: [{name: u, handle: a, translate: [0, 0, 1], also: [{handle: c}, {handle: b, scale: {}}]},\n"
      "            {name: v, handle: b, rotate: {axis: [1, 0, 0]}}]\n");
  EXPECT_THAT(region_labels(two, line()), ElementsAre(1, 0, 3, 0, 4, 2))
      << "fixed is what both fix, the first handle has a point";
  EXPECT_THAT(handle_points(two, "c", line()), ElementsAre(4, 5));
  EXPECT_THAT(handle_points(two, "a", line()), ElementsAre(5));
  expect_error(ErrorCode::invalid_argument, {"handle \"d\"", "no such handle"}, [&] { handle_points(two, "d", line()); });

  const v1::Setup first = setup_of_method(two, std::nullopt), second = setup_of_method(two, 0);
  EXPECT_EQ(first.then_size() + second.then_size(), 0);
  ASSERT_EQ(first.variables_size(), 1);
  EXPECT_EQ(first.variables(0).also_size(), 0);
  EXPECT_TRUE(second.method().has_shell());
  EXPECT_THAT(region_labels(second, line()), ElementsAre(1, 0, 2, 0, 3, 3));
  ASSERT_EQ(second.variables_size(), 2);
  EXPECT_EQ(second.variables(0).handle(), "c");
  EXPECT_THAT(second.variables(0).translate(), ElementsAre(0, 0, 1)) << "as the first handle moves";
  ASSERT_EQ(second.variables(0).also_size(), 1);
  EXPECT_TRUE(second.variables(0).also(0).has_scale());
  EXPECT_EQ(second.variables(1).name(), "v");
  expect_error(ErrorCode::invalid_argument, {"--then 1", "1 further method"}, [&] { setup_of_method(two, 1); });
  expect_error(ErrorCode::invalid_argument, {"then: only one"}, [&] { refuse_several_methods(two, "only one"); });
  EXPECT_NO_THROW(refuse_several_methods(first, "only one"));
}

TEST(RegionLabels, OfTheBoundary) {
  Mesh mesh = line();
  mesh.face_sizes = {3};
  mesh.face_points = {1, 2, 3};
  EXPECT_THAT(region_labels(setup("handles: [{name: a, region: {boundary: true}}]\n"), mesh), ElementsAre(0, 2, 2, 2, 0, 0));
}

// The same sentences as those of deform::validate(), see setup_test.cpp.
TEST(ResolvedRegions, CollectAllThatIsWrong) {
  const ResolvedRegions resolved = resolve_regions(
      setup("handles: [{name: a, region: {ids: [0, 1]}}, {name: b, region: {ids: [1, 2]}}, {name: c, region: {group: top}},\n"
            "          {name: d, region: {all: true, ids: [3]}}, {name: e, region: {sphere: {centre: [9, 9], radius: 1}}}]\n"
            "fixed: [{ids: [2, 3]}, {box: {min: [7, 7, 7], max: [8, 8, 8]}}]\n"
            "constraints: [{name: k, planar: {}, regions: [{ids: [4, 5]}, {ids: [77]}]}]\n"),
      line());
  EXPECT_THAT(resolved.labels, ElementsAre(2, 2, 3, 1, 0, 0)) << "the first keeps a point that two want";
  EXPECT_THAT(resolved.contested, ElementsAre(1, 2));
  EXPECT_THAT(resolved.handles, ElementsAre("a", "b", "c", "d", "e"));
  ASSERT_EQ(resolved.constraints.size(), 1u);
  EXPECT_EQ(resolved.constraints[0].kind, "planar");
  EXPECT_THAT(resolved.constraints[0].regions[0], ElementsAre(4, 5));
  using testing::HasSubstr;
  EXPECT_THAT(resolved.problems,
              ElementsAre("handle \"b\" overlaps handle \"a\": 1 common points, the first is point 1; subtract one region from "
                          "the other with `difference`",
                          HasSubstr("handle \"c\": group \"top\" does not exist"),
                          "handle \"d\": expected exactly one kind of region, got ids and all",
                          "handle \"e\".sphere.centre: expected 3 numbers, got 2",
                          HasSubstr("fixed[0] overlaps handle \"b\": 1 common points, the first is point 2"),
                          "fixed[1]: its region contains no point; the model's box is [0, 0, 0] to [5, 0, 0]",
                          HasSubstr("constraints[0].regions[1]: ids[0]: point 77")));
}

const char* const with_controls =
    "method: {ffd: {control: CONTROLS, lattice: {box: {min: [-1, -1, -1], max: [6, 1, 1]}, points: [6, 4, 5]}}}\n"
    "handles: [{name: a, region: {lattice: {i: [4, 5], j: [1, 1], k: [0, 0]}}}]\n";

TEST(RegionLabels, ControlPointsAreNoRegionsOfTheMesh) {
  EXPECT_THAT(region_labels(setup(with_controls), line()), ElementsAre(0, 0, 0, 0, 0, 0));
  EXPECT_THAT(handle_points(setup(with_controls), "a", line()), ElementsAre(10, 11)) << "for motion files";
  test::expect_error(ErrorCode::invalid_argument, {"CONTROLS", "deform lattice"},
                     [] { resolve_regions(setup(with_controls), line()); });
}

TEST(RegionLabels, NamesTheRegionThatCannotBeSelected) {
  test::expect_error(ErrorCode::invalid_argument, {"handle \"roof\"", "group \"top\""},
                     [] { region_labels(setup("handles: [{name: roof, region: {group: top}}]\n"), line()); });
  test::expect_error(ErrorCode::invalid_argument, {"fixed[0]", "6"},
                     [] { region_labels(setup("fixed: [{ids: [6]}]\n"), line()); });
}

}  // namespace
}  // namespace deform::cli::region_labels_test
