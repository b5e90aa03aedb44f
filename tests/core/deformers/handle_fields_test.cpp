// SPDX-License-Identifier: GPL-3.0-or-later
// Designs as combinations of fields, against the points that the systems evaluate: for every kind of basis, in several units; and
// the check of cells with and without them.
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>

#include "core/base/vectors.h"
#include "core/mesh/ahmed.h"
#include "core/quality/safe_amplitude.h"
#include "tests/core/deformers/block_meshes.h"
#include "tests/core/deformers/energy_cases.h"
#include "tests/core/quality/cell_by_cell.h"

namespace deform::handle_fields_test {
namespace {

struct Model {
  std::string name;
  Mesh mesh;
  deform::Setup setup;
};

Model volume(const decltype(deform::Setup::method)& method, std::size_t n, double unit, const std::string& name) {
  Model model{name, test::cube(n).mesh, {}};
  model.setup.method = method;
  model.setup.handles = {{"top", test::box({0.2 * unit, 0.2 * unit, 0.99 * unit}, {0.8 * unit, 0.8 * unit, unit})},
                         {"side", test::box({0.99 * unit, 0.2 * unit, 0.2 * unit}, {unit, 0.6 * unit, 0.6 * unit})}};
  model.setup.fixed = {test::box({-unit, -unit, -unit}, {2 * unit, 2 * unit, 0.01 * unit})};
  for (Vec3& x : model.mesh.points) x = unit * x;
  return model;
}

template <typename Options>
Options to(double tolerance) {
  Options options;
  options.basis_tolerance = tolerance;
  return options;
}

/// All handles moved, turned and stretched a little about their middle, by amounts of up to `size`.
Design design_of(const Model& model, double size, std::mt19937_64& random) {
  std::uniform_real_distribution<double> uniform(-size, size);
  const double D = bounding_box(model.mesh.points).diagonal();
  Design design;
  for (std::size_t h = 0; h < model.setup.handles.size(); ++h) {
    Affine map = identity_affine;
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t j = 0; j < 3; ++j) map[4 * i + j] += uniform(random);
      map[4 * i + 3] = uniform(random) * D;
    }
    design.motions.push_back({h, map});
  }
  return design;
}

/// What may be between the points and the combination of the fields, at each point.
void expect_combination(const System& system, const Mesh& mesh, const Design& design, double allowed) {
  const auto fields = system.displacement_fields();
  ASSERT_NE(fields, nullptr);
  const auto bound = system.bind({&design, 1}, EvaluationPath::basis, {});
  const auto motion = bound->field_motion(0);
  ASSERT_TRUE(motion.has_value());
  ASSERT_EQ(motion->coefficients.size(), fields->count());
  const Points points = system.evaluate({&design, 1}, EvaluationPath::basis)[0];
  std::vector<double> values(mesh.point_count() * fields->count());
  fields->values(0, fields->count(), values, {});
  double worst = 0, most = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    Vec3 to = mesh.points[i];
    double bounded = motion->rounding;
    for (std::size_t f = 0; f < fields->count(); ++f) {
      const double value = values[i * fields->count() + f];
      to = to + value * motion->coefficients[f];
      bounded += motion->uncertainties[f] * std::abs(value) + fields->error(f) * norm(motion->coefficients[f]);
    }
    const double off = distance(points[i], to);
    worst = std::max(worst, off / bounded);
    most = std::max(most, bounded);
  }
  EXPECT_LE(worst, 1);
  EXPECT_LE(most, allowed * bounding_box(mesh.points).diagonal());
  // In parts they are the same.
  std::vector<double> part(mesh.point_count() * 3);
  fields->values(2, 3, part, {});
  for (std::size_t i = 0; i < mesh.point_count(); i += 7) {
    for (std::size_t k = 0; k < 3; ++k) EXPECT_EQ(part[3 * i + k], values[i * fields->count() + 2 + k]);
  }
}

TEST(HandleFields, DesignsAreCombinationsOfThem) {
  std::mt19937_64 random(3);
  for (const double unit : {1e-3, 1.0, 1e3}) {
    for (const double tolerance : {0.0, 1e-6}) {
      MlsOptions few_samples = to<MlsOptions>(tolerance);
      few_samples.domain = MlsDomain::connected;
      const Model models[] = {volume(to<RbfOptions>(tolerance), 9, unit, "rbf"), volume(few_samples, 4, unit, "mls")};
      for (const Model& model : models) {
        if (model.name == "mls" && unit != 1) continue;  // takes long
        SCOPED_TRACE(testing::Message() << model.name << ", unit " << unit << ", tolerance " << tolerance);
        const auto system = prepare(test::shared(model.mesh), model.setup);
        for (const double size : {1e-3, 0.3, 3.0}) {
          expect_combination(*system, model.mesh, design_of(model, size, random), (1e-12 + 20 * tolerance) * (1 + 10 * size));
        }
      }
    }
  }
}

TEST(HandleFields, FarFromTheOrigin) {
  std::mt19937_64 random(4);
  Model model = volume(RbfOptions{}, 7, 1, "far");
  for (Vec3& x : model.mesh.points) x = x + Vec3{1e4, -2e4, 3e4};
  const auto moved = [](Region region) {
    auto& box = std::get<Region::InBox>(region.kind);
    box.min = box.min + Vec3{1e4, -2e4, 3e4};
    box.max = box.max + Vec3{1e4, -2e4, 3e4};
    return region;
  };
  for (Handle& handle : model.setup.handles) handle.region = moved(handle.region);
  for (Region& region : model.setup.fixed) region = moved(region);
  const auto system = prepare(test::shared(model.mesh), model.setup);
  expect_combination(*system, model.mesh, design_of(model, 0.1, random), 1e-6);
}

TEST(HandleFields, WithPlanesOfSymmetry) {
  for (const double tolerance : {0.0, 1e-7}) {
    Model model = volume(to<RbfOptions>(tolerance), 8, 1, "half");
    model.setup.handles = {{"top", test::box({0, 0.2, 0.99}, {0.5, 0.8, 1})}};
    model.setup.symmetry.push_back({SymmetryPlane::Plane{{0, 0, 0}, {1, 0, 0}}});
    const auto system = prepare(test::shared(model.mesh), model.setup);
    const Design design{{}, {{0, Affine{1.1, 0, 0, 0, 0, 1.2, 0.1, 0.05, 0, 0, 1, 0.3}}}};
    expect_combination(*system, model.mesh, design, 1e-12 + 20 * tolerance);
  }
}

TEST(HandleFields, OnlyDesignsOnTheBasisPathHaveThem) {
  const Model model = volume(RbfOptions{}, 5, 1, "rbf");
  std::mt19937_64 random(5);
  const Design design = design_of(model, 0.01, random);
  const auto system = prepare(test::shared(model.mesh), model.setup);
  EXPECT_TRUE(system->bind({&design, 1}, EvaluationPath::automatic, {})->field_motion(0).has_value());
  EXPECT_FALSE(system->bind({&design, 1}, EvaluationPath::direct, {})->field_motion(0).has_value());
  deform::Setup without = model.setup;
  std::get<RbfOptions>(without.method).basis = BasisMode::never;
  const auto bare = prepare(test::shared(model.mesh), without);
  EXPECT_EQ(bare->displacement_fields(), nullptr);
  EXPECT_FALSE(bare->bind({&design, 1}, EvaluationPath::automatic, {})->field_motion(0).has_value());
}

// From designs that hardly deform to such as invert most cells: every bit of what every single cell says.
TEST(HandleFields, TheCheckOfCellsSaysTheSame) {
  std::mt19937_64 random(6);
  for (const double tolerance : {0.0, 1e-6}) {
    Model model = volume(to<RbfOptions>(tolerance), 10, 1, "rbf");
    const Elements elements = test::cube(10).elements;
    const auto system = prepare(test::shared(model.mesh), model.setup);
    const auto fields = system->displacement_fields();
    const InversionCheck check(model.mesh.points, &elements, *fields);
    for (const double size : {0.0, 1e-4, 1e-3, 0.01, 0.03, 0.1, 0.5}) {
      for (int k = 0; k < 3; ++k) {
        SCOPED_TRACE(testing::Message() << tolerance << ", size " << size << ", " << k);
        const Design design = design_of(model, size, random);
        const auto bound = system->bind({&design, 1}, EvaluationPath::basis, {});
        const Points points = system->evaluate({&design, 1}, EvaluationPath::basis)[0];
        const SafeAmplitude found = check.amplitude(points, *bound->field_motion(0));
        test::expect_same(found, test::cell_by_cell(model.mesh.points, model.mesh.points, points, &elements));
        EXPECT_EQ(found.suspects, check.amplitude(model.mesh.points, points).suspects);
      }
    }
  }
}

}  // namespace
}  // namespace deform::handle_fields_test
