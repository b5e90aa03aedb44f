// SPDX-License-Identifier: GPL-3.0-or-later
// Cells beside exact points: walls with more points than an ExactStep has centres.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/methods.h"
#include "core/deformers/space_map.h"
#include "core/mesh/elements.h"
#include "tests/core/deformers/energy_cases.h"
#include "tests/core/deformers/estimate_bounds.h"
#include "tests/core/deformers/shapes.h"
#include "tests/support/long_tests.h"

namespace deform::test::exact_joins_test {
namespace {

constexpr double first_layer = 2e-5;  // of an annulus that is 2 wide

/// The room between a wall of radius 0.3 about the z axis and one of radius 1, 1.2 long, in hexahedra whose layers grow from the
/// inner wall outwards.
struct Annulus {
  std::size_t around, along, layers;
  double unit;
  std::shared_ptr<Mesh> mesh = std::make_shared<Mesh>();

  Annulus(std::size_t n_around, std::size_t n_along, std::size_t n_layers, double unit_of_lengths = 1)
      : around(n_around), along(n_along), layers(n_layers), unit(unit_of_lengths) {
    std::vector<double> radii{0.3};
    for (double h = first_layer; radii.size() < layers; h *= std::pow(0.15 / first_layer, 1.0 / static_cast<double>(layers))) {
      radii.push_back(radii.back() + h);
    }
    radii.push_back(1);
    for (std::size_t k = 0; k <= layers; ++k) {
      for (std::size_t j = 0; j <= along; ++j) {
        for (std::size_t i = 0; i < around; ++i) {
          const double turn = 2 * std::numbers::pi * static_cast<double>(i) / static_cast<double>(around);
          mesh->points.push_back(unit * Vec3{radii[k] * std::cos(turn), radii[k] * std::sin(turn),
                                             1.2 * static_cast<double>(j) / static_cast<double>(along)});
        }
      }
    }
    auto elements = std::make_shared<Elements>();
    for (std::size_t k = 0; k < layers; ++k) {
      for (std::size_t j = 0; j < along; ++j) {
        for (std::size_t i = 0; i < around; ++i) {
          const std::array<PointId, 8> nodes{at(i, j, k),     at(i, j, k + 1),     at(i + 1, j, k + 1),     at(i + 1, j, k),
                                             at(i, j + 1, k), at(i, j + 1, k + 1), at(i + 1, j + 1, k + 1), at(i + 1, j + 1, k)};
          elements->add(ElementType::hexahedron, nodes);
        }
      }
    }
    BoundaryFaces boundary = boundary_faces(*elements);
    mesh->face_sizes = std::move(boundary.sizes);
    mesh->face_points = std::move(boundary.points);
    mesh->elements = std::move(elements);
  }
  PointId at(std::size_t i, std::size_t j, std::size_t k) const {
    return static_cast<PointId>(i % around + around * (j + (along + 1) * k));
  }

  /// A dent of the outer wall moves, and all of it that is not around the dent stays; the inner wall follows as a cylinder.
  Setup setup(const MethodOptions& method, bool exact) const {
    std::vector<PointId> dent, still, wall;
    for (std::size_t j = 0; j <= along; ++j) {
      for (std::size_t i = 0; i < around; ++i) {
        const std::size_t off = std::min(i, around - i);
        if (12 * off <= around && 8 * j >= 3 * along && 8 * j <= 5 * along) dent.push_back(at(i, j, layers));
        if (6 * off >= around || 8 * j <= along || 8 * j >= 7 * along) still.push_back(at(i, j, layers));
        wall.push_back(at(i, j, 0));
      }
    }
    Setup setup;
    setup.method = method;
    setup.handles = {{"dent", {Region::Ids{dent}}}};
    setup.fixed = {{Region::Ids{still}}};
    setup.variables = {{"in", "dent", DesignVariable::Translate{unit * Vec3{-1, 0.3, 0.2}}},
                       {"turn", "dent", DesignVariable::Rotate{{0, 1, 0.2}, unit * Vec3{1, 0, 0.6}}}};
    setup.constraints = {{"wall", {{Region::Ids{wall}}}, Cylindrical{}, 0, exact}};
    return setup;
  }

  struct Heights {
    double least = std::numeric_limits<double>::infinity(), most = 0, difference = 0;
  };
  Heights heights(const Points& points) const {
    Heights result;
    for (std::size_t j = 0; j <= along; ++j) {
      for (std::size_t i = 0; i < around; ++i) {
        const Vec3 out = mesh->points[at(i, j, 1)] - mesh->points[at(i, j, 0)];
        const auto height = [&](std::size_t k) {
          return dot(points[at(i, j, k + 1)] - points[at(i, j, k)], out) /
                 dot(mesh->points[at(i, j, k + 1)] - mesh->points[at(i, j, k)], out);
        };
        result.least = std::min({result.least, height(0), height(1)});
        result.most = std::max({result.most, height(0), height(1)});
        result.difference = std::max(result.difference, std::abs(height(0) - height(1)));
      }
    }
    return result;
  }
};

const Design dented{{0.15, 0.1}, {}};

deform::Setup with_steps(deform::Setup setup, ExactSteps steps) {
  setup.constraint_options.exact_steps = steps;
  return setup;
}

double largest(const Points& a, const Points& b) {
  double result = 0;
  for (std::size_t i = 0; i < a.size(); ++i) result = std::max(result, distance(a[i], b[i]));
  return result;
}

TEST(ExactJoins, first_cells_keep_their_height_with_every_method) {
  const Annulus annulus(64, 40, 8);
  SubspaceOptions subspace;
  subspace.centres = 150;
  MlsOptions mls;
  mls.surface_samples = 250;
  mls.volume_samples = 100;
  for (const MethodOptions& method : {MethodOptions(FfdOptions{}), MethodOptions(subspace), MethodOptions(mls)}) {
    const deform::Setup setup = annulus.setup(method, true);
    const auto system = prepare(annulus.mesh, setup, {});
    expect_bounds(estimate(*annulus.mesh, setup), system->info());
    const auto bound = system->bind({&dented, 1}, EvaluationPath::direct, {});
    Points points(annulus.mesh->point_count());
    Vec3* const out = points.data();
    bound->evaluate(0, points.size(), 0, {&out, 1});
    const Annulus::Heights heights = annulus.heights(points);
    EXPECT_GT(heights.least, 0.4) << method.index();
    EXPECT_LT(heights.most, 4) << method.index();
    EXPECT_LT(heights.difference, 0.02) << method.index();
    const ConstraintReport& wall = bound->report(0).constraints[0];
    EXPECT_FALSE(wall.given_up || wall.missed) << method.index();
    EXPECT_LT(wall.max, 1e-12) << method.index();
  }
}

// What the rule is for. The steps onto the cylinder are thousands of times the height of these cells.
TEST(ExactJoins, centres_alone_invert_first_cells) {
  const Annulus annulus(64, 40, 8);
  const auto system = prepare(annulus.mesh, with_steps(annulus.setup(FfdOptions{}, true), ExactSteps::centres), {});
  const Annulus::Heights heights = annulus.heights(system->evaluate(dented));
  EXPECT_LT(heights.least, -3);
  EXPECT_GT(heights.most, 3);
}

// By the field itself, a hair beside exact, handle and fixed points, which are delivered where they belong whatever it is.
TEST(ExactJoins, the_field_is_that_of_all_joins) {
  const Annulus annulus(64, 40, 8);
  const auto system = prepare(annulus.mesh, annulus.setup(FfdOptions{}, true), {});
  constexpr double beside = 1e-9;
  const Points points = system->evaluate(dented);
  std::vector<Vec3> places, expected;
  for (const std::size_t layer : {std::size_t{0}, annulus.layers}) {
    for (std::size_t j = 0; j <= annulus.along; ++j) {
      for (std::size_t i = 0; i < annulus.around; ++i) {
        const PointId id = annulus.at(i, j, layer);
        const double towards = layer == 0 ? 1 + beside : 1 - beside;
        places.push_back(
            {towards * annulus.mesh->points[id][0], towards * annulus.mesh->points[id][1], annulus.mesh->points[id][2]});
        expected.push_back(points[id]);
      }
    }
  }
  std::vector<Vec3> out(places.size());
  system->bind_in_space(dented, {})->evaluate(places, 0, out, {});
  for (std::size_t i = 0; i < places.size(); ++i) EXPECT_LT(distance(out[i], expected[i]), 5 * beside) << i;
}

// Many points of a regular mesh are equally far from those that are centres already: rounding decides nothing.
TEST(ExactJoins, units_do_not_matter) {
  if (!long_tests()) return;  // each of the two takes ten seconds
  constexpr double unit = 1000;
  const Annulus annulus(64, 40, 6), other(64, 40, 6, unit);
  const Points right = prepare(annulus.mesh, annulus.setup(FfdOptions{}, true), {})->evaluate(dented);
  const Points points = prepare(other.mesh, other.setup(FfdOptions{}, true), {})->evaluate(dented);
  double off = 0;
  for (std::size_t i = 0; i < points.size(); ++i) off = std::max(off, distance(points[i] / unit, right[i]));
  EXPECT_LT(off, 1e-6) << "a solver's tolerance of 1e-7 D";
}

TEST(ExactJoins, refinement_of_the_mesh_does_not_change_the_motion) {
  if (!long_tests()) return;  // the fine one takes twenty seconds
  // The same places in a mesh twice as fine: every second point.
  const Annulus coarse(48, 32, 6), fine(96, 64, 6);
  const auto moved = [&](const Annulus& annulus) {
    return prepare(annulus.mesh, annulus.setup(FfdOptions{}, true), {})->evaluate(dented);
  };
  const Points a = moved(coarse), b = moved(fine);
  double worst = 0, motion = 0;
  for (std::size_t k = 0; k < coarse.layers; ++k) {
    for (std::size_t j = 0; j <= coarse.along; ++j) {
      for (std::size_t i = 0; i < coarse.around; ++i) {
        const PointId id = coarse.at(i, j, k);
        worst = std::max(worst, distance(a[id], b[fine.at(2 * i, 2 * j, k)]));
        motion = std::max(motion, distance(a[id], coarse.mesh->points[id]));
      }
    }
  }
  EXPECT_LT(worst, 0.05 * motion);
}

TEST(ExactJoins, derivatives_are_those_of_the_motion) {
  const Annulus annulus(64, 40, 4);
  deform::Setup setup = annulus.setup(FfdOptions{}, true);
  setup.constraint_options.tolerance = 1e-12;
  const auto system = prepare(annulus.mesh, setup, {});
  const std::vector<double> direction{0.5, -0.3};
  constexpr double h = 1e-4;
  const auto moved = [&](double by) {
    return system->evaluate({{dented.variables[0] + by * direction[0], dented.variables[1] + by * direction[1]}, {}});
  };
  const Points above = moved(h), below = moved(-h), product = system->jacobian_vector(dented.variables, direction, {});
  Points cotangent(product.size());
  double off = 0, left = 0, size = 0;
  for (std::size_t i = 0; i < product.size(); ++i) {
    const double t = static_cast<double>(i);
    cotangent[i] = {std::sin(t), std::cos(2 * t), std::sin(3 * t)};
    off = std::max(off, distance(product[i], (above[i] - below[i]) / (2 * h)));
    left += dot(product[i], cotangent[i]);
    size += std::abs(dot(product[i], cotangent[i]));
  }
  EXPECT_LT(off, 1e-5);
  const std::vector<double> gradient = system->vector_jacobian(dented.variables, cotangent, {});
  EXPECT_NEAR(left, gradient[0] * direction[0] + gradient[1] * direction[1], 1e-9 * size);
}

/// A sheet in which a band becomes flat, with thin cells on both sides of it.
struct Sheet {
  std::shared_ptr<Mesh> mesh = std::make_shared<Mesh>();
  std::vector<PointId> band;
  std::vector<std::array<PointId, 2>> rims;  ///< a point of the band and the one beside it
  static constexpr std::size_t nx = 140, ny = 60;
  static constexpr double thin = 1e-5;

  Sheet() {
    std::vector<double> y;
    for (std::size_t j = 0; j <= ny; ++j) y.push_back(static_cast<double>(j) / ny);
    y[first - 1] = y[first] - thin;
    y[last + 1] = y[last] + thin;
    for (std::size_t j = 0; j <= ny; ++j) {
      for (std::size_t i = 0; i <= nx; ++i) {
        const double x = 2 * static_cast<double>(i) / nx;
        mesh->points.push_back({x, y[j], 0.1 * std::sin(3 * x) * std::cos(4 * y[j])});
      }
    }
    const auto at = [](std::size_t i, std::size_t j) { return static_cast<PointId>(i + (nx + 1) * j); };
    for (std::size_t j = 0; j < ny; ++j) {
      for (std::size_t i = 0; i < nx; ++i) {
        for (const PointId id : {at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)}) mesh->face_points.push_back(id);
        mesh->face_sizes.push_back(4);
      }
    }
    for (std::size_t j = first; j <= last; ++j) {
      for (std::size_t i = 10; i <= nx - 10; ++i) band.push_back(at(i, j));
    }
    for (std::size_t i = 10; i <= nx - 10; ++i) {
      rims.push_back({at(i, first), at(i, first - 1)});
      rims.push_back({at(i, last), at(i, last + 1)});
    }
  }

 private:
  static constexpr std::size_t first = 20, last = 44;
};

TEST(ExactJoins, surfaces_have_no_steps_beside_exact_points) {
  const Sheet sheet;
  deform::Setup setup;
  setup.method = ShellOptions{};
  setup.handles = {{"side", box({-1, 0.99, -1}, {3, 1.01, 1})}};
  setup.fixed = {box({-1, -0.01, -1}, {3, 0.01, 1})};
  setup.variables = {{"up", "side", DesignVariable::Translate{{0, 0, 1}}}};
  for (const HandleMode mode : {HandleMode::hard, HandleMode::soft}) {
    setup.method = ShellOptions{};
    std::get<ShellOptions>(setup.method).handles = mode;
    setup.constraints = {{"band", {{Region::Ids{sheet.band}}}, Planar{}, 1e-2, true}};
    const Design up{{0.1}, {}};
    const auto system = prepare(sheet.mesh, setup, {});
    const Points exact = system->evaluate(up);
    setup.constraints[0].exact = false;
    const Points soft = prepare(sheet.mesh, setup, {})->evaluate(up);
    double step = 0, jump = 0;
    for (const auto& [on, beside] : sheet.rims) {
      step = std::max(step, distance(exact[on], soft[on]));
      jump = std::max(jump, distance(exact[on] - soft[on], exact[beside] - soft[beside]));
    }
    EXPECT_GT(step, 0.01);
    EXPECT_LT(jump, Sheet::thin);
    if (mode == HandleMode::hard) continue;
    setup.constraints[0].exact = true;
    // Handles that give way may hold exact points.
    setup.handles[0].region = {Region::Union{{setup.handles[0].region, {Region::Ids{sheet.band}}}}};
    const auto inside = prepare(sheet.mesh, setup, {});
    const auto bound = inside->bind({&up, 1}, EvaluationPath::automatic, {});
    EXPECT_FALSE(bound->report(0).constraints[0].missed);
  }
}

// Few exact and held points are all centres, so that there is nothing else to choose. The steps start from the same soft result,
// that of stored setups.
TEST(ExactJoins, few_points_are_carried_as_before) {
  const Annulus annulus(16, 10, 4);
  FfdOptions stored;
  stored.misfit = MisfitRule::centres;
  const auto moved = [&](ExactSteps steps) {
    return prepare(annulus.mesh, with_steps(annulus.setup(stored, true), steps), {})->evaluate(dented);
  };
  EXPECT_LT(largest(moved(ExactSteps::joins), moved(ExactSteps::centres)), 1e-12);
}

}  // namespace
}  // namespace deform::test::exact_joins_test
