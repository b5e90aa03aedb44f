// SPDX-License-Identifier: GPL-3.0-or-later
// Control points as handles in the sector of a wheel, against the whole wheel without a sector.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/methods.h"
#include "core/deformers/space_map.h"
#include "core/deformers/system.h"
#include "tests/core/deformers/energy_cases.h"
#include "tests/core/deformers/estimate_bounds.h"
#include "tests/core/deformers/wheel.h"
#include "tests/support/expect_error.h"

namespace deform::sector_controls_test {
namespace {

using test::SectorModel;
using test::WholeWheel;

const std::vector<double> some_values{0.1, 0.15, 0.2, -0.1};

/// Four variables of "blade", which is to hold control points.
void add_variables(SectorModel& model) {
  const test::Frame& frame = model.frame;
  model.setup.variables = {{"along", "blade", DesignVariable::Translate{frame.axes[0] + 0.3 * frame.axes[1]}},
                           {"turn", "blade", DesignVariable::Rotate{frame.axes[2], frame.point({0.4, 0.7, 0})}},
                           {"grow", "blade", DesignVariable::Scale{frame.point({0.4, 0.7, 0}), frame.axes[1]}},
                           {"stagger", "blade", DesignVariable::Rotate{frame.axes[1], frame.point({0.4, 0.7, 0})}}};
  model.setup.fixed.clear();
}

/// A lattice around the middle of the sector, which reaches into others.
SectorModel with_lattice(std::size_t count, double hub, std::uint64_t seed, const test::Frame& frame) {
  SectorModel model({count, hub, seed}, frame);
  add_variables(model);
  model.setup.method = test::sector_lattice(frame);
  model.setup.handles[0].region = {Region::LatticeRange{
      {Region::LatticeRange::Range{1, 3}, Region::LatticeRange::Range{1, 4}, Region::LatticeRange::Range{1, 3}}}};
  return model;
}

/// What the lattice does in the wheel without its images: of each point of the wheel.
Points of_one_lattice(const SectorModel& model, const WholeWheel& whole, const Design& design) {
  deform::Setup setup = model.setup;
  setup.symmetry.clear();
  Points moved = prepare(whole.wheel, setup)->evaluate(design);
  for (std::size_t i = 0; i < moved.size(); ++i) moved[i] = moved[i] - whole.wheel->points[i];
  return moved;
}

/// A displacement, turned by a number of sectors.
Vec3 turned_vector(const SectorModel& model, const Vec3& u, std::size_t sectors) {
  const auto turns = static_cast<double>(sectors);
  return model.turned_point(model.frame.origin + u, turns) - model.frame.origin;
}

TEST(SectorControls, EverySectorHasAnImageOfTheLattice) {
  for (const auto& [count, hub, seed] :
       {std::tuple<std::size_t, double, std::uint64_t>{5, 0.4, 1}, {5, 0.0, 2}, {2, 0.0, 1}, {9, 0.3, 2}}) {
    SCOPED_TRACE(count);
    const SectorModel model = with_lattice(count, hub, seed, test::oblique());
    const WholeWheel whole(SectorModel({count, hub, seed}, test::oblique()));
    const Design design{some_values, {}};
    const Points moved = of_one_lattice(model, whole, design);
    const auto system = prepare(model.sector, model.setup);
    test::check_jacobians(*system, 1e-11, 1e-6);
    const double rounding = 1e-14 * (bounding_box(whole.wheel->points).diagonal() + norm(model.frame.origin));
    for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
      const Points got = system->evaluate({&design, 1}, path)[0];
      double off = 0, farthest = 0;
      for (std::size_t i = 0; i < got.size(); ++i) {
        Vec3 sum{};
        for (std::size_t g = 0; g < count; ++g) {
          sum = sum + turned_vector(model, moved[whole.image_of[(count - g) % count][i]], g);
        }
        off = std::max(off, distance(got[i], model.sector->points[i] + sum));
        farthest = std::max(farthest, norm(sum));
      }
      EXPECT_LT(off, 10 * rounding);
      EXPECT_GT(farthest, 0.1);
      EXPECT_LE(model.out_of_turn(got), rounding);
    }
    const auto map = system->bind_in_space(design, {});
    Points in_space(model.sector->point_count());
    map->evaluate(model.sector->points, 0, in_space, {});
    EXPECT_LT(test::distance(in_space, system->evaluate(design)), rounding);
    EXPECT_THAT(system->info().notes, testing::Contains(testing::HasSubstr("where displacements add up")));
    test::expect_bounds(estimate(*model.sector, model.setup), system->info());
  }
}

CageOptions can(const SectorModel& model, std::uint32_t sides) {
  CageOptions options;
  options.basis = BasisMode::always;
  test::make_can(model, sides, 1.5, options);
  return options;
}

TEST(SectorControls, ACageAroundTheWheelMovesWithItsImages) {
  for (const std::size_t count : {2, 3, 8}) {
    SCOPED_TRACE(count);
    const std::uint32_t sides = count == 2 ? 3 : 2, ring = sides * static_cast<std::uint32_t>(count);
    SectorModel model({count, 0.0, count}, test::oblique());
    const WholeWheel whole(model);
    add_variables(model);
    model.setup.method = can(model, sides);
    model.setup.handles[0].region = {Region::ControlIds{{0, ring + 1}}};
    // The wheel: a handle for each vertex that moves.
    deform::Setup wheel = model.setup;
    wheel.symmetry.clear();
    wheel.handles.clear();
    wheel.variables.clear();
    const Design design{some_values, {}};
    const Affine motion = handle_motions(model.setup, design.variables)[0];
    Design of_wheel;
    for (std::uint32_t g = 0; g < count; ++g) {
      const auto turn = [&](std::uint32_t vertex, std::uint32_t first) { return first + (vertex - first + g * sides) % ring; };
      of_wheel.motions.push_back({wheel.handles.size(), test::turned_motion(model, motion, g)});
      wheel.handles.push_back({"of " + std::to_string(g), {Region::ControlIds{{turn(0, 0), turn(ring + 1, ring)}}}});
    }
    const Points expected = prepare(whole.wheel, wheel)->evaluate(of_wheel);
    const double rounding = 1e-14 * (bounding_box(whole.wheel->points).diagonal() + norm(model.frame.origin));
    const auto expect_wheel = [&](const System& system) {
      for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
        const Points got = system.evaluate({&design, 1}, path)[0];
        EXPECT_LT(test::distance(got, Points(expected.begin(), expected.begin() + static_cast<std::ptrdiff_t>(got.size()))),
                  1e-12);
        EXPECT_LE(model.out_of_turn(got), rounding);
      }
    };
    const auto system = prepare(model.sector, model.setup);
    expect_wheel(*system);
    EXPECT_GT(test::distance(system->evaluate(design), model.sector->points), 0.05);
    test::check_jacobians(*system, 1e-11, 1e-6);
    EXPECT_THAT(system->info().notes, testing::Contains(testing::HasSubstr("are images of these and move with them")));
    test::expect_bounds(estimate(*model.sector, model.setup), system->info());

    // A handle that holds vertices of all sectors must move them alike, and those on the axis along it.
    deform::Setup all = model.setup;
    all.handles[0].region = {Region::ControlIds{{0, sides}}};
    test::expect_error(ErrorCode::invalid_argument, {"control points", "images of each other", "sector"},
                       [&] { prepare(model.sector, all)->evaluate(design); });
    all.handles[0].region = {Region::ControlIds{{2 * ring}}};
    const auto on_axis = prepare(model.sector, all);
    test::expect_error(ErrorCode::invalid_argument, {"control points", "by 1 sector"}, [&] { on_axis->evaluate(design); });
    const Design along{{},
                       {{0, Affine{1, 0, 0, 0.1 * model.frame.axes[0][0], 0, 1, 0, 0.1 * model.frame.axes[0][1], 0, 0, 1,
                                   0.1 * model.frame.axes[0][2]}}}};
    const Points got = on_axis->evaluate(along);
    EXPECT_LE(model.out_of_turn(got), rounding);
    EXPECT_GT(test::distance(got, model.sector->points), 0.01);
    all = model.setup;
    all.fixed = {{Region::ControlIds{{sides}}}};
    test::expect_error(ErrorCode::invalid_argument, {"control point 0 moves", "is in a fixed region", "images of each other by"},
                       [&] { prepare(model.sector, all); });
  }
}

TEST(SectorControls, RefusesOtherCages) {
  SectorModel model({5, 0.4, 1});
  add_variables(model);
  CageOptions options = can(model, 2);
  options.vertices[3][0] -= 0.01;
  model.setup.method = options;
  model.setup.handles[0].region = {Region::ControlIds{{0}}};
  test::expect_error(ErrorCode::invalid_argument, {"method.cage", "wheel of 5 sectors", "vertex 1 has no image"},
                     [&] { prepare(model.sector, model.setup); });
}

}  // namespace
}  // namespace deform::sector_controls_test
