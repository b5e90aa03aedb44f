// SPDX-License-Identifier: GPL-3.0-or-later
// Sectors with the methods that deform the whole wheel, and what is made of systems of sectors: maps of space, compositions,
// compiled deformations.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "core/compiled/deformation.h"
#include "core/compiled/reader.h"
#include "core/compiled/records.h"
#include "core/deformers/compiled_form.h"
#include "core/deformers/mirrored_system.h"
#include "core/deformers/space_map.h"
#include "core/quality/displacement_fields.h"
#include "tests/core/deformers/compiled_deformation.h"
#include "tests/core/deformers/estimate_bounds.h"
#include "tests/core/deformers/shapes.h"
#include "tests/core/deformers/wheel.h"
#include "tests/core/numerics/cages.h"
#include "tests/support/expect_error.h"

namespace deform::sector_methods_test {
namespace {

using test::casing;
using test::SectorModel;
using test::WholeWheel;

double rounding_of(const SectorModel& model) {
  return 1e-14 * (bounding_box(model.sector->points).diagonal() + norm(model.frame.origin));
}

TEST(SectorMethods, ShellOfASectorIsThatOfTheWheel) {
  for (const std::size_t count : {2, 3, 8}) {
    SectorModel model = casing({count, 0.4, 2, 6, 2, 8}, test::oblique());
    model.setup.method = ShellOptions{};
    const WholeWheel whole(model);
    const auto system = prepare(model.sector, model.setup);
    EXPECT_EQ(system->info().points, model.local.size());
    const auto wheel = prepare(whole.wheel, whole.setup);
    for (const bool affine : {false, true}) {
      const Points got = system->evaluate(affine ? model.affine_design() : model.design());
      const Points expected = wheel->evaluate(affine ? whole.affine_design : whole.design);
      EXPECT_LT(test::distance(got, Points(expected.begin(), expected.begin() + static_cast<std::ptrdiff_t>(got.size()))), 1e-9);
      EXPECT_GT(test::distance(got, model.sector->points), 0.05);
      EXPECT_LE(model.out_of_turn(got), rounding_of(model));
    }
  }
}

TEST(SectorMethods, LatticeOfASectorIsThatOfTheWheel) {
  for (const double hub : {0.4, 0.0}) {
    SectorModel model({5, hub, 1});
    FfdOptions options;
    options.lattice.points = {9, 9, 9};
    model.setup.method = options;
    const WholeWheel whole(model);
    const Points got = prepare(model.sector, model.setup)->evaluate(model.affine_design());
    const Points expected = prepare(whole.wheel, whole.setup)->evaluate(whole.affine_design);
    // The lattice is not symmetric: the mean of what the wheel does in all sectors.
    double off = 0;
    for (std::size_t i = 0; i < got.size(); ++i) {
      Vec3 mean{};
      for (std::size_t g = 0; g < model.shape.count; ++g) {
        mean = mean + model.turned_point(expected[whole.image_of[g][i]], -static_cast<double>(g)) / 5.0;
      }
      off = std::max(off, distance(got[i], mean));
    }
    EXPECT_LT(off, 1e-8);
    EXPECT_LE(model.out_of_turn(got), rounding_of(model));
  }
}

/// The automatic clamp of a sector whose hub moves is that of a wheel whose hub is one handle.
TEST(SectorMethods, AutomaticClampsAreThoseOfTheWheel) {
  SectorModel model({5, 0.4, 1});
  FfdOptions options;
  options.control = FfdControl::mesh;
  options.lattice.points = {4, 9, 9};
  model.setup.method = options;
  Region::Ids hub, casing;
  for (std::size_t i = 0; i <= model.shape.around; ++i) {
    for (std::size_t k = 0; k <= model.shape.along; ++k) {
      hub.ids.push_back(model.at_grid(i, 0, k));
      casing.ids.push_back(model.at_grid(i, model.shape.outwards, k));
    }
  }
  model.setup.handles[0].region = {hub};
  model.setup.fixed = {{casing}};
  model.setup.variables = {{"along", "blade", DesignVariable::Translate{model.frame.axes[0]}},
                           {"around", "blade", DesignVariable::Rotate{model.frame.axes[0], model.frame.origin}}};
  const WholeWheel whole(model);
  deform::Setup wheel = whole.setup;
  std::vector<Region> hubs;
  for (const Handle& handle : wheel.handles) hubs.push_back(handle.region);
  wheel.handles = {{"blade", {Region::Union{hubs}}}};
  const Design design{{0.1, 0.2}, {}};
  const Points got = prepare(model.sector, model.setup)->evaluate(design);
  const Points expected = prepare(whole.wheel, wheel)->evaluate(design);
  double off = 0;
  for (std::size_t i = 0; i < got.size(); ++i) {
    Vec3 mean{};  // of what the wheel does in all sectors
    for (std::size_t g = 0; g < model.shape.count; ++g) {
      mean = mean + model.turned_point(expected[whole.image_of[g][i]], -static_cast<double>(g)) / 5.0;
    }
    off = std::max(off, distance(got[i], mean));
  }
  EXPECT_LT(off, 1e-9 * bounding_box(whole.wheel->points).diagonal());
}

deform::Setup with_variables(const SectorModel& model) {
  deform::Setup setup = model.setup;
  const auto& frame = model.frame;
  setup.variables = {{"stretch", "blade", DesignVariable::Scale{frame.origin, frame.axes[1]}, -0.5, 0.5},
                     {"lift", "blade", DesignVariable::Translate{frame.axes[2]}, -0.5, 0.5},
                     {"stagger", "blade", DesignVariable::Rotate{frame.axes[1], frame.point({0.4, 0.7, 0})}, -0.5, 0.5}};
  return setup;
}

std::vector<std::pair<std::string, MethodOptions>> all_methods() {
  FfdOptions ffd, by_mesh;
  ffd.lattice.points = by_mesh.lattice.points = {7, 7, 7};
  by_mesh.control = FfdControl::mesh;
  by_mesh.clamp = 1e-4;
  SubspaceOptions subspace;
  subspace.centres = 60;
  MlsOptions mls;
  mls.surface_samples = 120;
  mls.volume_samples = 60;
  const test::CageMesh box = test::box_cage({-0.5, -1.5, -1.6}, {1.4, 1.6, 1.5});
  CageOptions cage;
  cage.vertices = box.vertices;
  cage.triangles = box.triangles;
  cage.control = CageControl::mesh;
  cage.clamp = 1e-6;
  return {{"rbf", RbfOptions{}}, {"shell", ShellOptions{}}, {"subspace", subspace}, {"mls", mls},
          {"ffd", ffd},          {"ffd MESH", by_mesh},     {"cage MESH", cage}};
}

TEST(SectorMethods, PartnersAndDerivatives) {
  for (const auto& [name, method] : all_methods()) {
    for (const std::size_t count : {2, 5}) {
      SCOPED_TRACE(name + " " + std::to_string(count));
      // The shell needs a surface.
      SectorModel model =
          name == "shell" ? casing({count, 0.4, 2, 6, 2, 8}, {}) : SectorModel({count, name == "subspace" ? 0.4 : 0.0, 1});
      model.frame = test::Frame{};
      deform::Setup setup = with_variables(model);
      setup.method = method;
      if (name == "cage MESH") {
        for (Vec3& x : std::get<CageOptions>(setup.method).vertices) x = x + model.frame.origin;
      }
      const auto system = prepare(model.sector, setup);
      test::expect_bounds(estimate(*model.sector, setup), system->info());
      const std::vector<double> at{0.1, -0.05, 0.07}, direction{0.3, 1, -0.4};
      const auto moved = [&](double t) {
        std::vector<double> values = at;
        for (std::size_t k = 0; k < at.size(); ++k) values[k] += t * direction[k];
        return system->evaluate(Design{values, {}});
      };
      const Points rest = system->evaluate(Design{{0, 0, 0}, {}});
      EXPECT_LT(test::distance(rest, model.sector->points), 1e-13);
      const Points got = moved(0);
      EXPECT_GT(test::distance(got, model.sector->points), 0.01);
      EXPECT_LE(model.out_of_turn(got), rounding_of(model));
      const Points derivative = system->jacobian_vector(at, direction, {});
      const double h = 1e-4;
      const Points high = moved(h), low = moved(-h);
      std::mt19937_64 random(7);
      std::uniform_real_distribution<double> uniform(-1, 1);
      Points cotangent(derivative.size());
      double product = 0, off = 0;
      for (std::size_t i = 0; i < derivative.size(); ++i) {
        for (std::size_t k = 0; k < 3; ++k) {
          off = std::max(off, std::abs(derivative[i][k] - (high[i][k] - low[i][k]) / (2 * h)));
          cotangent[i][k] = uniform(random);
          product += cotangent[i][k] * derivative[i][k];
        }
      }
      EXPECT_LT(off, 1e-7);
      const std::vector<double> gradient = system->vector_jacobian(at, cotangent, {});
      double same = 0;
      for (std::size_t k = 0; k < at.size(); ++k) same += gradient[k] * direction[k];
      EXPECT_NEAR(same, product, 1e-9 * std::max(1.0, std::abs(product)));
      // A handle and its images meet at the boundaries, and are missed far more where they part than where they turn together.
      const DesignReport on_basis = system->bind({{{at, {}}}}, EvaluationPath::basis, {})->report(0);
      const DesignReport direct = system->bind({{{at, {}}}}, EvaluationPath::direct, {})->report(0);
      EXPECT_LE(on_basis.interpolation_residual, 1.001 * direct.interpolation_residual + 1e-12);
      // Points do not depend on the range that they are asked for with.
      std::vector<double> small = direction;
      for (double& v : small) v *= 0.1;
      const std::vector<Design> both{{at, {}}, {small, {}}};
      const auto evaluation = system->bind(both, EvaluationPath::automatic, {});
      for (std::size_t i = 0; i < got.size(); ++i) {
        Vec3 place{};
        Vec3* const to = &place;
        evaluation->evaluate(i, i + 1, 0, {&to, 1});
        EXPECT_EQ(place, got[i]) << i;
      }
    }
  }
}

// At the points of the mesh a map of space is what the direct path gives, and it repeats elsewhere.
TEST(SectorMethods, MapsOfSpaceRepeat) {
  for (const auto& [name, method] : all_methods()) {
    if (name == "shell" || name == "subspace") continue;
    SCOPED_TRACE(name);
    SectorModel model({5, 0, 1});
    deform::Setup setup = with_variables(model);
    setup.method = method;
    if (name == "cage MESH") {
      for (Vec3& x : std::get<CageOptions>(setup.method).vertices) x = x + model.frame.origin;
    }
    const auto system = prepare(model.sector, setup);
    const Design design{{0.1, -0.05, 0.07}, {}};
    const auto map = system->bind_in_space(design, {});
    Points got(model.local.size());
    map->evaluate(model.sector->points, 0, got, {});
    const Points direct = system->evaluate({&design, 1}, EvaluationPath::direct)[0];
    EXPECT_LT(test::distance(got, direct), name == "rbf" ? 1e-300 : 1e-13);
    std::vector<Vec3> places, images;
    for (std::size_t i = 0; i < 40; ++i) {
      const Vec3 y{0.05 + 0.017 * static_cast<double>(i), 0.3 + 0.01 * static_cast<double>(i),
                   0.2 * std::sin(static_cast<double>(i))};
      places.push_back(model.frame.point(y));
      images.push_back(model.turned_point(places.back(), 2));
    }
    Points moved(places.size()), moved_images(places.size());
    map->evaluate(places, 0, moved, {});
    map->evaluate(images, 0, moved_images, {});
    for (std::size_t i = 0; i < places.size(); ++i) {
      EXPECT_LT(distance(moved_images[i], model.turned_point(moved[i], 2)), 1e-11) << i;
    }
    EXPECT_GT(test::distance(moved, places), 0.01);
  }
}

TEST(SectorMethods, ComposedSetupsKeepPartners) {
  SectorModel model({5, 0.0, 1}, test::oblique());
  deform::Setup setup = with_variables(model);
  setup.then.push_back({RbfOptions{}, setup.fixed});
  Handle hub{"tip", {Region::Ids{{model.at_grid(1, 1, 1), model.at_grid(2, 1, 1)}}}};
  hub.stage = 1;
  setup.handles.push_back(hub);
  setup.variables.push_back({"tip", "tip", DesignVariable::Translate{model.frame.axes[2]}});
  const auto system = prepare(model.sector, setup);
  const Points got = system->evaluate(Design{{0.1, -0.05, 0.07, 0.04}, {}});
  EXPECT_LE(model.out_of_turn(got), 10 * rounding_of(model));
  EXPECT_GT(test::distance(got, model.sector->points), 0.02);
}

// What checks of cells are made of: the displacement of every point as a sum of fields.
TEST(SectorMethods, FieldsAddUpToTheMotion) {
  for (const std::size_t count : {2, 5}) {
    SectorModel model({count, 0, 1}, test::oblique());
    deform::Setup setup = with_variables(model);
    setup.handles.push_back({"shaft", {Region::Ids{{model.axis[0], model.axis[1]}}}});
    setup.variables.push_back({"along", "shaft", DesignVariable::Translate{model.frame.axes[0]}});
    RbfOptions options;
    options.basis = BasisMode::always;
    setup.method = options;
    const auto system = prepare(model.sector, setup);
    const std::vector<Design> designs{{{0.1, -0.05, 0.07, 0.03}, {}}};
    const auto evaluation = system->bind(designs, EvaluationPath::basis, {});
    const auto motion = evaluation->field_motion(0);
    const auto fields = system->displacement_fields();
    ASSERT_TRUE(motion && fields);
    const std::size_t n = model.local.size(), terms = fields->count();
    ASSERT_EQ(motion->coefficients.size(), terms);
    std::vector<double> values(n * terms);
    fields->values(0, terms, values, {});
    const Points expected = system->evaluate(designs[0]);
    double off = 0;
    for (std::size_t i = 0; i < n; ++i) {
      Vec3 x = model.sector->points[i];
      for (std::size_t f = 0; f < terms; ++f) x = x + values[i * terms + f] * motion->coefficients[f];
      off = std::max(off, distance(x, expected[i]));
    }
    EXPECT_LT(off, 1e-13);
    EXPECT_LE(off, motion->rounding);
  }
}

TEST(SectorMethods, CompiledDeformationIsTheSystem) {
  for (const std::size_t count : {2, 5}) {
    for (const double tolerance : {0.0, 1e-9}) {
      const SectorModel model({count, 0, 1}, test::oblique());
      deform::Setup setup = with_variables(model);
      RbfOptions options;
      options.basis = BasisMode::always;
      options.basis_tolerance = tolerance;
      setup.method = options;
      const auto system = prepare(model.sector, setup);
      const compiled::Deformation deformation = test::compiled_deformation(system);
      const std::vector<double> at{0.1, -0.05, 0.07}, direction{0.3, 1, -0.4};
      const Points right = system->evaluate(Design{at, {}});
      std::vector<double> flat(3 * right.size());
      const auto off = [&](const Points& points) {
        double largest = 0;
        for (std::size_t i = 0; i < points.size(); ++i) {
          for (std::size_t k = 0; k < 3; ++k) largest = std::max(largest, std::abs(points[i][k] - flat[3 * i + k]));
        }
        return largest;
      };
      deformation.evaluate(at, flat);
      EXPECT_LE(off(right), 1e-14 * (system->info().diagonal + norm(model.frame.origin)));
      const auto evaluation = system->bind(std::vector<Design>{{at, {}}}, EvaluationPath::automatic, {});
      EXPECT_NEAR(deformation.report(at).error, evaluation->report(0).error, 1e-3 * evaluation->report(0).error);
      deformation.jacobian_vector(at, direction, flat);
      EXPECT_LE(off(system->jacobian_vector(at, direction, {})), 1e-13);
      std::vector<double> gradient(3);
      deformation.vector_jacobian(at, std::span<const double>(right[0].data(), flat.size()), gradient);
      const std::vector<double> transposed = system->vector_jacobian(at, right, {});
      for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(gradient[k], transposed[k], 1e-11 * std::abs(transposed[k]));
    }
  }
}

TEST(SectorMethods, RefusesWhatTheyCannot) {
  SectorModel model({5, 0, 1});
  deform::Setup setup = with_variables(model);
  setup.handles.push_back({"shaft", {Region::Ids{{model.axis[0]}}}});
  test::expect_error(ErrorCode::failed_precondition, {"cannot be compiled", "\"shaft\"", "axis"},
                     [&] { CompiledForm form(prepare(model.sector, setup)); });
  deform::Setup mls = with_variables(model);
  mls.method = MlsOptions{};
  test::expect_error(ErrorCode::failed_precondition, {"cannot be compiled", "method rbf"},
                     [&] { CompiledForm form(prepare(model.sector, mls)); });
  mls.constraints = {{"flat", {{Region::Ids{model.lows}}}, Planar{}}};
  test::expect_error(ErrorCode::invalid_argument, {"constraints", "sector"}, [&] { prepare(model.sector, mls); });
  // What partners must do holds for all methods.
  deform::Setup ffd = model.setup;
  ffd.method = FfdOptions{};
  ffd.handles = {{"low", {Region::Ids{model.lows}}}, {"high", {Region::Ids{model.highs}}}};
  ffd.fixed.clear();
  const auto system = prepare(model.sector, ffd);
  test::expect_error(ErrorCode::invalid_argument, {"designs[0]", "\"low\"", "partners on the periodic boundaries"}, [&] {
    system->evaluate(Design{{}, {{0, model.motion()}}});
  });
  const Points got = system->evaluate(Design{{}, {{0, model.motion()}, {1, test::turned_motion(model, model.motion(), 1)}}});
  EXPECT_LE(model.out_of_turn(got), rounding_of(model));
}

}  // namespace
}  // namespace deform::sector_methods_test
