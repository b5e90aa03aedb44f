// SPDX-License-Identifier: GPL-3.0-or-later
// Variables of two-dimensional files against what writing their designs makes of them.
#include "client/cli/setup/plane_variables.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "client/cli/setup/prescribed_places.h"
#include "client/cli/setup/reading.h"
#include "core/base/error.h"
#include "core/io/mesh_file.h"

namespace deform::cli::plane_variables_test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

/// A strip of two squares.
const char* const strip =
    "NDIME= 2\nNELEM= 2\n9 0 1 4 3 0\n9 1 2 5 4 1\nNPOIN= 6\n0 0 0\n1 0 1\n2 0 2\n0 1 3\n1 1 4\n2 1 5\n"
    "NMARK= 2\nMARKER_TAG= left\nMARKER_ELEMS= 1\n3 0 3\nMARKER_TAG= right\nMARKER_ELEMS= 1\n3 2 5\n";

v1::Setup setup(const std::string& variables) {
  v1::Setup setup;
  parse_yaml("handles: [{name: left, region: {group: left}}, {name: right, region: {group: right}}]\nvariables:\n" + variables,
             "setup.yaml", setup);
  return setup;
}

std::vector<std::string> fields(const v1::Setup& setup, const Mesh& mesh) {
  Problems problems(Problems::Mode::collect);
  check_plane_variables(setup, mesh, problems);
  std::vector<std::string> found;
  for (const Problem& problem : problems.list()) found.push_back(problem.field);
  return found;
}

struct Case {
  const char* variable;
  bool leaves;
};

TEST(PlaneVariables, AreThoseWhoseDesignsCannotBeWritten) {
  const auto file = io::parse_mesh(strip, "strip.su2");
  ASSERT_TRUE(file->two_dimensional());
  for (const auto& [variable, leaves] : std::vector<Case>{
           {"{translate: [0, 0, 1], handle: right}", true},
           {"{translate: [1, 2, 1e-10], handle: right, lower: -1, upper: 1}", true},
           {"{translate: [1, 2, 0], handle: right}", false},
           {"{translate: [0, 0, 1], handle: right, lower: 0, upper: 0}", false},
           {"{translate: [0, 0, 1], handle: right, lower: -0.1, upper: 0}", true},
           {"{translate: [1, 0, 0], handle: left, also: [{handle: right, translate: [0, 0, 1]}]}", true},
           {"{translate: [1, 0, 0], handle: left, also: [{handle: right}]}", false},
           {"{rotate: {axis: [0, 0, 3], centre: [1, 1, 5]}, handle: right}", false},
           {"{rotate: {axis: [1, 0, 0]}, handle: right}", true},
           {"{rotate: {axis: [0, 1, 0], centre: [2, 0, 0]}, handle: right}", false},  // the points are on the axis
           {"{rotate: {axis: [0, 1, 0]}, handle: right}", true},
           {"{scale: {centre: [1, 1, 0]}, handle: right}", false},
           {"{scale: {centre: [1, 1, 1]}, handle: right}", true},
           {"{scale: {centre: [1, 1, 1], axis: [1, 1, 0]}, handle: right}", false},
       }) {
    const v1::Setup given = setup(std::string("  - ") + variable + "\n");
    // The oracle: the handles' points moved to the bounds, or by 1 both ways, written to the file.
    bool refused = false;
    for (const double end : {1.0, -1.0}) {
      const v1::DesignVariable& only = given.variables(0);
      const double value = end > 0 ? (only.has_upper() ? only.upper() : end) : (only.has_lower() ? only.lower() : end);
      Points points = file->mesh()->points;
      for (const auto& [name, ids] :
           std::vector<std::pair<const char*, std::vector<PointId>>>{{"left", {0, 3}}, {"right", {2, 5}}}) {
        for (const PointId id : ids) points[id] = transformed(handle_motion(given, name, std::vector{value}), points[id]);
      }
      try {
        file->with_points(points);
      } catch (const Error&) {
        refused = true;
      }
    }
    EXPECT_EQ(refused, leaves) << variable;
    EXPECT_EQ(!fields(given, *file->mesh()).empty(), leaves) << variable;
  }
}

TEST(PlaneVariables, AreAllNamed) {
  const auto file = io::parse_mesh(strip, "strip.su2");
  const v1::Setup given = setup(
      "  - {name: a, handle: left, translate: [0, 0, 1]}\n  - {name: b, handle: left, translate: [0, 1, 0]}\n"
      "  - {name: c, handle: right, translate: [0, 0, 1]}\n");
  EXPECT_THAT(fields(given, *file->mesh()), ElementsAre("variables[0]", "variables[2]"));
  Problems problems(Problems::Mode::collect);
  check_plane_variables(given, *file->mesh(), problems);
  EXPECT_THAT(problems.list()[1].message, HasSubstr("variables[2] (\"c\"): point 2 of handle \"right\" leaves its plane"));
}

TEST(PlaneVariables, OfControlPointsAreNotLookedAt) {
  const auto file = io::parse_mesh(strip, "strip.su2");
  v1::Setup given;
  parse_yaml(
      "method: {ffd: {control: CONTROLS}}\nhandles: [{name: right, region: {lattice: {i: [0, 0]}}}]\n"
      "variables: [{name: a, handle: right, translate: [0, 0, 1]}]\n",
      "setup.yaml", given);
  EXPECT_THAT(fields(given, *file->mesh()), ElementsAre());
}

}  // namespace
}  // namespace deform::cli::plane_variables_test
