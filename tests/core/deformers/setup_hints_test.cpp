// SPDX-License-Identifier: GPL-3.0-or-later
// How far bounds move points, against designs at many values between them; and what is said about setups that are rarely meant.
#include "core/deformers/setup_hints.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "core/base/vectors.h"
#include "tests/core/deformers/shapes.h"

namespace deform::setup_hints_test {
namespace {

using Texts = std::vector<std::string>;
constexpr double infinity = std::numeric_limits<double>::infinity();

deform::Setup bounded_setup() {
  deform::Setup setup;
  setup.handles = {{"end", test::box({1.7, -1, -0.5}, {3, 2, 0.5})}, {"middle", test::box({0.9, -1, -0.5}, {1.1, 2, 0.5})}};
  setup.fixed = {test::box({-1, -1, -0.5}, {0.3, 2, 0.5})};
  setup.variables = {{"up", "end", DesignVariable::Translate{{0, 3, 4}}, -0.1, 0.02},
                     {"turn", "end", DesignVariable::Rotate{{0, 2, 1}, {0.4, 0, 0.1}}, -0.5, 0.2},
                     {"half", "end", DesignVariable::Rotate{{0, 1, 0}, {1, 0, 0}, AngleUnit::degrees}, -20, 270},
                     {"big", "middle", DesignVariable::Scale{{0, 0, 0}, {0, 0, 0}}, -0.2, 0.3},
                     {"wide", "middle", DesignVariable::Scale{{0, 0.2, 0}, {0, 3, 0}}, 0, 0.4},
                     {"both", "middle", DesignVariable::Translate{{0, 0, 1}}, -0.1, 0.1}};
  setup.variables[5].also = {{"end", DesignVariable::Rotate{{0, 1, 0}, {0, 0, 0}}}};
  return setup;
}

TEST(SetupHints, ReachesAreTheLargestDisplacementsBetweenTheBounds) {
  const Mesh mesh = test::bumpy_sheet(20, 10);
  deform::Setup setup = bounded_setup();
  const SelectedRegions regions = validate(setup, mesh);
  const auto reaches = variable_reaches(mesh, setup, regions);
  ASSERT_EQ(reaches.size(), setup.variables.size());
  constexpr int steps = 2900;  // a half turn of 290 degrees is one of them
  for (std::size_t k = 0; k < reaches.size(); ++k) {
    const DesignVariable& variable = setup.variables[k];
    double largest = 0;
    for (int step = 0; step <= steps; ++step) {
      std::vector<double> values(setup.variables.size());
      values[k] = variable.lower + (variable.upper - variable.lower) * step / steps;
      const std::vector<Affine> maps = handle_motions(setup, values);
      for (std::size_t h = 0; h < maps.size(); ++h) {
        for (const PointId id : regions.handles[h]) {
          largest = std::max(largest, distance(transformed(maps[h], mesh.points[id]), mesh.points[id]));
        }
      }
    }
    ASSERT_TRUE(reaches[k]);
    EXPECT_NEAR(*reaches[k], largest, 1e-12) << variable.name;
  }
  setup.variables[1].upper = infinity;
  EXPECT_FALSE(variable_reaches(mesh, setup, regions)[1]);
}

TEST(SetupHints, NotesOfVariables) {
  const Mesh mesh = test::bumpy_sheet(20, 10);
  const double D = bounding_box(mesh.points).diagonal();
  deform::Setup setup = bounded_setup();
  const auto note = [&](DesignVariable variable) {
    setup.variables = {std::move(variable)};
    const Texts notes = variable_notes(mesh, setup, validate(setup, mesh));
    return notes.empty() ? std::string() : notes.at(0);
  };
  const DesignVariable::Translate up{{0, 0, 1}};
  char text[100];
  std::snprintf(text, sizeof text, "Variable up: bounds move points by up to 0.3 (%.3g D).", 0.3 / D);
  EXPECT_EQ(note({"up", "end", up, -0.3, 0.1}), text);
  EXPECT_EQ(note({"up", "end", up, -infinity, 0.1}), "");
  const char* hardly = "hardly anything; are they in the units of the mesh?";
  EXPECT_NE(note({"up", "end", up, -0.99e-4 * D, 0}).find(hardly), std::string::npos);
  EXPECT_EQ(note({"up", "end", up, -1.01e-4 * D, 0}).find(hardly), std::string::npos);

  const char* far = "farther than the model is long; are they in the units of the mesh?";
  EXPECT_NE(note({"up", "end", up, 0, 1.01 * D}).find(far), std::string::npos);
  EXPECT_EQ(note({"up", "end", up, 0, 0.99 * D}).find(far), std::string::npos);

  const DesignVariable::Rotate turn{{0, 1, 0}, {0, 0, 0}}, degrees{{0, 1, 0}, {0, 0, 0}, AngleUnit::degrees};
  EXPECT_NE(note({"turn", "end", turn, -15, 15})
                .find("They turn handle \"end\" by up to 15 radians, 2.39 turns; for degrees give the rotation unit: DEGREES."),
            std::string::npos);
  EXPECT_NE(note({"turn", "end", turn, -3, 3.15}).find("by up to 3.15 radians, 0.501 turns"), std::string::npos);
  EXPECT_EQ(note({"turn", "end", turn, -3.14, 3.14}).find("turns"), std::string::npos);
  EXPECT_NE(note({"turn", "end", degrees, -361, 5}).find("361 degrees, 1 turns."), std::string::npos);
  EXPECT_EQ(note({"turn", "end", degrees, -360, 360}).find("turns"), std::string::npos);

  const DesignVariable::Scale scale{{0, 0, 0}, {0, 0, 1}};
  EXPECT_NE(note({"fat", "end", scale, -40, 60}).find("At -40 they mirror handle \"end\": a scale of v multiplies by 1 + v"),
            std::string::npos);
  EXPECT_NE(note({"fat", "end", scale, -1, infinity}).find("Variable fat: see the bounds. At -1 they flatten handle"),
            std::string::npos);
  EXPECT_EQ(note({"fat", "end", scale, -0.99, 60}).find("multiplies"), std::string::npos);
  EXPECT_EQ(note({"fat", "end", scale, -infinity, infinity}), "");
  DesignVariable both{"up", "end", up, -2, 2};
  both.also = {{"middle", scale}};
  EXPECT_NE(note(both).find("mirror handle \"middle\""), std::string::npos);

  setup.variables.clear();
  for (int k = 0; k < 101; ++k) setup.variables.push_back({"v" + std::to_string(k), "end", up, -1, 1});
  const Texts many = variable_notes(mesh, setup, validate(setup, mesh));
  ASSERT_EQ(many.size(), 101u);
  EXPECT_EQ(many.back(), "Notes on bounds are about the first 100 variables only.");
}

/// A trough that is closed but for its top at z = `top`, open nowhere else; its floor is 10 x 10 quads.
Mesh trough(double top) {
  Mesh mesh = test::bumpy_sheet(11, 11);
  std::vector<PointId> around;
  for (PointId i = 0; i < 10; ++i) around.push_back(i);
  for (PointId j = 0; j < 10; ++j) around.push_back(10 + 11 * j);
  for (PointId i = 0; i < 10; ++i) around.push_back(120 - i);
  for (PointId j = 0; j < 10; ++j) around.push_back(110 - 11 * j);
  const auto first = static_cast<PointId>(mesh.point_count());
  for (const PointId id : around) mesh.points.push_back({mesh.points[id][0], mesh.points[id][1], top});
  for (PointId k = 0; k < 40; ++k) {
    const PointId next = (k + 1) % 40;
    mesh.face_sizes.push_back(4);
    for (const PointId id : {around[k], around[next], first + next, first + k}) mesh.face_points.push_back(id);
  }
  return mesh;
}

TEST(SetupHints, AHalfModelWithoutItsPlane) {
  const Mesh mesh = trough(2);
  deform::Setup setup;
  setup.handles = {{"floor", test::box({0.5, 0.3, -1}, {1, 0.7, 1})}};
  const auto note = [&](const Mesh& of) { return half_model_note(of, setup, validate(setup, of)); };
  EXPECT_EQ(note(mesh),
            "The surface is open at z = 2 only: if it is half of a model, its rim leaves this plane unless `symmetry` gives it.");
  EXPECT_NE(note(trough(-3)).find("open at z = -3 only"), std::string::npos);
  EXPECT_EQ(note(trough(0.01)), "") << "not a side of the bounding box";
  EXPECT_EQ(note(test::bumpy_sheet(11, 11)), "") << "open on four sides";
  Mesh bent = mesh;
  bent.points.back()[2] -= 1e-3;
  EXPECT_EQ(note(bent), "");
  setup.fixed = {test::box({-1, -1, 1.9}, {3, 3, 2.1})};
  EXPECT_EQ(note(mesh), "") << "the rim is fixed";
  setup.fixed = {test::box({-1, -1, 1.9}, {1, 3, 2.1})};
  EXPECT_NE(note(mesh), "") << "a part of it";
  setup.symmetry.push_back({SymmetryPlane::Plane{{0, 0, 2}, {0, 0, 1}}});
  EXPECT_EQ(note(mesh), "");
}

}  // namespace
}  // namespace deform::setup_hints_test
