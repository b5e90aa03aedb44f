// SPDX-License-Identifier: GPL-3.0-or-later
// Cells beside handle and fixed points, where the functions of energy methods are coarser than the mesh.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/methods.h"
#include "core/deformers/space_map.h"
#include "core/mesh/elements.h"
#include "tests/core/deformers/energy_cases.h"
#include "tests/core/deformers/estimate_bounds.h"
#include "tests/core/deformers/shapes.h"

namespace deform::test::misfit_rule_test {
namespace {

constexpr double first_layer = 2e-5;  // of a channel that is 2 long

/// A channel over the wall z = 0, [0, 2] x [0, 1] x [0, 0.6], in hexahedra: `layers` of them grow from the first layer on.
struct Channel {
  std::size_t nx, ny, nz;
  std::shared_ptr<Mesh> mesh = std::make_shared<Mesh>();

  Channel(std::size_t along, std::size_t across, std::size_t layers) : nx(along), ny(across), nz(layers) {
    std::vector<double> z{0};
    for (double h = first_layer; z.size() <= nz; h *= std::pow(0.15 / first_layer, 1.0 / static_cast<double>(nz))) {
      z.push_back(z.back() + h);
    }
    for (std::size_t k = 0; k <= nz; ++k) {
      for (std::size_t j = 0; j <= ny; ++j) {
        for (std::size_t i = 0; i <= nx; ++i) {
          mesh->points.push_back(
              {2 * static_cast<double>(i) / static_cast<double>(nx), static_cast<double>(j) / static_cast<double>(ny), z[k]});
        }
      }
    }
    auto elements = std::make_shared<Elements>();
    for (std::size_t k = 0; k < nz; ++k) {
      for (std::size_t j = 0; j < ny; ++j) {
        for (std::size_t i = 0; i < nx; ++i) {
          const std::array<PointId, 8> nodes{at(i, j, k),     at(i + 1, j, k),     at(i + 1, j + 1, k),     at(i, j + 1, k),
                                             at(i, j, k + 1), at(i + 1, j, k + 1), at(i + 1, j + 1, k + 1), at(i, j + 1, k + 1)};
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
    return static_cast<PointId>(i + (nx + 1) * (j + (ny + 1) * k));
  }
  double top() const { return mesh->points.back()[2]; }

  /// The bump of the wall moves, the outer wall, the ends and the top stay; a ring of the wall and all inside follow.
  Setup setup(const MethodOptions& method) const {
    Setup setup;
    setup.method = method;
    setup.handles = {{"bump", box({0.65, 0.25, -1e-9}, {1.35, 0.75, 1e-9})}};
    setup.fixed = {box({-1e-9, -1, -1}, {1e-9, 2, 2}), box({2 - 1e-9, -1, -1}, {2 + 1e-9, 2, 2}),
                   box({-1, -1, top() - 1e-9}, {3, 2, 2}), box({-1, -1, -1e-9}, {0.35, 2, 1e-9}),
                   box({1.65, -1, -1e-9}, {3, 2, 1e-9})};
    setup.variables = {{"up", "bump", DesignVariable::Translate{{0.1, 0, 1}}},
                       {"turn", "bump", DesignVariable::Rotate{{0, 1, 0.2}, {1, 0.5, 0}}}};
    return setup;
  }

  /// The least height of the first two layers after a deformation, over that at rest, and how much these two numbers differ at
  /// most over a point of the wall. Fields that are smooth for the layers stretch both alike.
  struct Heights {
    double least = std::numeric_limits<double>::infinity(), difference = 0;
  };
  Heights heights(const Points& points) const {
    Heights result;
    for (std::size_t j = 0; j <= ny; ++j) {
      for (std::size_t i = 0; i <= nx; ++i) {
        const auto height = [&](std::size_t k) {
          const PointId low = at(i, j, k), high = at(i, j, k + 1);
          return (points[high][2] - points[low][2]) / (mesh->points[high][2] - mesh->points[low][2]);
        };
        result.least = std::min({result.least, height(0), height(1)});
        result.difference = std::max(result.difference, std::abs(height(0) - height(1)));
      }
    }
    return result;
  }
};

FfdOptions ffd(MisfitRule rule) {
  FfdOptions options;
  options.misfit = rule;
  return options;
}
SubspaceOptions subspace(MisfitRule rule) {
  SubspaceOptions options;
  options.centres = 150;
  options.misfit = rule;
  return options;
}
MlsOptions mls(MisfitRule rule) {
  MlsOptions options;
  options.surface_samples = 250;
  options.volume_samples = 100;
  options.misfit = rule;
  return options;
}

Design bumped(double up, double turn) { return {{up, turn}, {}}; }

TEST(MisfitRule, first_cells_keep_their_height_with_every_method) {
  const Channel channel(56, 28, 10);
  const auto heights = [&](const MethodOptions& method) {
    const auto system = prepare(channel.mesh, channel.setup(method), {});
    expect_bounds(estimate(*channel.mesh, channel.setup(method)), system->info());
    const Channel::Heights all = channel.heights(system->evaluate(bumped(0.05, 0.04)));
    const DesignReport direct = system->bind(std::vector<Design>{bumped(0.05, 0.04)}, EvaluationPath::direct, {})->report(0);
    EXPECT_LT(direct.interpolation_residual, 1e-3 * first_layer);
    EXPECT_LT(direct.error, 1e-9);
    return all;
  };
  for (const MethodOptions& method : {MethodOptions(ffd(MisfitRule::joins)), MethodOptions(subspace(MisfitRule::joins)),
                                      MethodOptions(mls(MisfitRule::joins))}) {
    const Channel::Heights of = heights(method);
    EXPECT_GT(of.least, 0.3) << method.index();
    EXPECT_LT(of.difference, 0.02) << method.index();
  }
}

// Many points of a regular mesh are equally far from those that are centres already: rounding decides nothing.
TEST(MisfitRule, units_do_not_matter) {
  constexpr double unit = 1000;
  Channel channel(56, 28, 10);
  const deform::Setup setup = channel.setup(ffd(MisfitRule::joins));
  const Points right = prepare(channel.mesh, setup, {})->evaluate(bumped(0.05, 0.04));
  deform::Setup scaled = setup;
  Channel other(56, 28, 10);
  for (Vec3& x : other.mesh->points) x = unit * x;
  const auto scale = [&](Region& region) {
    auto& at = std::get<Region::InBox>(region.kind);
    at.min = unit * at.min;
    at.max = unit * at.max;
  };
  for (Handle& handle : scaled.handles) scale(handle.region);
  for (Region& region : scaled.fixed) scale(region);
  for (DesignVariable& variable : scaled.variables) {
    if (auto* rotation = std::get_if<DesignVariable::Rotate>(&variable.kind)) rotation->centre = unit * rotation->centre;
  }
  const Points points = prepare(other.mesh, scaled, {})->evaluate(bumped(unit * 0.05, 0.04));
  double off = 0;
  for (std::size_t i = 0; i < points.size(); ++i) off = std::max(off, distance(points[i] / unit, right[i]));
  EXPECT_LT(off, 1e-9);
}

// What the rule is for: with some of the points alone the first cells are inside out, and the error says so.
TEST(MisfitRule, centres_alone_invert_first_cells) {
  const Channel channel(56, 28, 10);
  const auto system = prepare(channel.mesh, channel.setup(ffd(MisfitRule::centres)), {});
  const Channel::Heights of = channel.heights(system->evaluate(bumped(0.05, 0.04)));
  EXPECT_LT(of.least, 0);
  EXPECT_GT(of.difference, 0.5);
  EXPECT_GT(system->bind(std::vector<Design>{bumped(0.05, 0.04)}, EvaluationPath::basis, {})->report(0).error, 1e-6);
}

// By the field itself, a hair beside handle and fixed points, which are delivered as prescribed whatever it is.
TEST(MisfitRule, the_field_is_the_prescribed_one_at_all_joins) {
  const Channel channel(56, 28, 10);
  const auto system = prepare(channel.mesh, channel.setup(ffd(MisfitRule::joins)), {});
  const Design design = bumped(0.05, 0.04);
  constexpr double beside = 1e-9;
  const Points points = system->evaluate(design);
  std::vector<Vec3> places, expected;
  for (std::size_t j = 0; j <= channel.ny; ++j) {
    for (std::size_t i = 0; i <= channel.nx; ++i) {
      const PointId id = channel.at(i, j, 0);
      places.push_back(channel.mesh->points[id]);
      places.back()[2] += beside;
      expected.push_back(points[id]);
    }
  }
  std::vector<Vec3> out(places.size());
  system->bind_in_space(design, {})->evaluate(places, 0, out, {});
  for (std::size_t i = 0; i < places.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(out[i][k], expected[i][k], 3 * beside) << i;
  }
}

TEST(MisfitRule, refinement_of_the_mesh_does_not_change_the_motion) {
  // The same places in a mesh twice as fine: every second point.
  const Channel coarse(40, 20, 8), fine(80, 40, 8);
  const auto moved = [&](const Channel& channel) {
    return prepare(channel.mesh, channel.setup(ffd(MisfitRule::joins)), {})->evaluate(bumped(0.05, 0.04));
  };
  const Points a = moved(coarse), b = moved(fine);
  double worst = 0;
  for (std::size_t k = 0; k <= coarse.nz; ++k) {
    for (std::size_t j = 0; j <= coarse.ny; ++j) {
      for (std::size_t i = 0; i <= coarse.nx; ++i) {
        const Vec3 &x = a[coarse.at(i, j, k)], &y = b[fine.at(2 * i, 2 * j, k)];
        worst = std::max(worst, std::hypot(x[0] - y[0], x[1] - y[1], x[2] - y[2]));
      }
    }
  }
  EXPECT_LT(worst, 0.02 * 0.05);
}

TEST(MisfitRule, both_paths_and_derivatives_agree) {
  deform::Setup setup = setup_with_variables();
  const auto mesh = std::make_shared<const Mesh>(bumpy_sheet(80, 50));
  FfdOptions options = ffd(MisfitRule::joins);
  setup.fixed.push_back(box({-1, -1, -1}, {0.9, 2, 1}));
  for (const BasisMode mode : {BasisMode::always, BasisMode::never}) {
    options.basis = mode;
    setup.method = options;
    const auto system = prepare(mesh, setup, {});
    EXPECT_GT(system->info().constraint_points, 2000u);
    check_jacobians(*system, 1e-11, 1e-7);
    if (mode == BasisMode::never) continue;
    check_population(*system, 3);
    const Design design{{0.1, 0.2, 0.1, -0.2}, {}};
    const Points basis = system->evaluate({&design, 1}, EvaluationPath::basis)[0];
    const Points direct = system->evaluate({&design, 1}, EvaluationPath::direct)[0];
    for (std::size_t i = 0; i < basis.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(basis[i][k], direct[i][k], 1e-11);
    }
  }
}

TEST(MisfitRule, first_cells_of_half_models_keep_their_height_too) {
  const Channel half(48, 14, 8);
  deform::Setup setup = half.setup(ffd(MisfitRule::joins));
  setup.symmetry = {{SymmetryPlane::Plane{{0, 1, 0}, {0, 1, 0}}}};
  setup.handles[0].region = box({0.65, 0.5, -1e-9}, {1.35, 2, 1e-9});
  setup.variables = {{"up", "bump", DesignVariable::Translate{{0.1, 0, 1}}}};
  const auto system = prepare(half.mesh, setup, {});
  const Points points = system->evaluate(Design{{0.05}, {}});
  const Channel::Heights of = half.heights(points);
  EXPECT_GT(of.least, 0.2);
  EXPECT_LT(of.difference, 0.02);
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (half.mesh->points[i][1] == 1) {
      EXPECT_EQ(points[i][1], 1);
    }
  }
}

}  // namespace
}  // namespace deform::test::misfit_rule_test
