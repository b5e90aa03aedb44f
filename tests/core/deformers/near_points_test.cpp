// SPDX-License-Identifier: GPL-3.0-or-later
// Handle and fixed points that nearly coincide, as noise of CAD programs and single precision make them: points beside a symmetry
// plane with their images, and points of patches that were not welded. Results are those for points that coincide.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/system.h"
#include "tests/core/deformers/shapes.h"

namespace deform::test::near_points_test {
namespace {

/// The half y >= 0 of a hull of a length of 4 units, with a bulb; its stem, keel and stern are on the plane y = 0.
struct HalfHull {
  std::size_t nx, nz;
  double unit;
  std::shared_ptr<Mesh> mesh = std::make_shared<Mesh>();

  /// The points of the stem are `beside` (of `unit`) beside the plane.
  HalfHull(std::size_t along, std::size_t down, double of_unit, double beside) : nx(along), nz(down), unit(of_unit) {
    for (std::size_t i = 0; i <= nx; ++i) {
      for (std::size_t j = 0; j <= nz; ++j) {
        const double a = static_cast<double>(i) / static_cast<double>(nx) - 0.5;
        const double b = static_cast<double>(j) / static_cast<double>(nz);
        const bool on = i == 0 || i == nx || j == nz;
        double y = on ? 0 : 0.2 * (1 - 4 * a * a) * (1 - b * b);
        if (!on) {
          y += 0.03 * std::exp(-(std::pow((4 * a - 1.75) / 0.12, 2) + std::pow((0.18 - 0.25 * b) / 0.05, 2))) * (1 - b * b);
        }
        if (i == nx) y = beside;
        mesh->points.push_back(unit * Vec3{4 * a, y, -0.25 * b});
      }
    }
    for (std::size_t i = 0; i < nx; ++i) {
      for (std::size_t j = 0; j < nz; ++j) {
        mesh->face_sizes.push_back(4);
        for (const PointId id : {at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)}) mesh->face_points.push_back(id);
      }
    }
  }
  PointId at(std::size_t i, std::size_t j) const { return static_cast<PointId>(i * (nz + 1) + j); }

  /// The bow below the deck turns about y, the aft half stays.
  Setup setup(const MethodOptions& method) const {
    Setup setup;
    setup.method = method;
    setup.handles = {{"bow", ids([](const Vec3& x) { return x[0] >= 1.15 && x[2] < -0.01; })}};
    setup.fixed = {ids([](const Vec3& x) { return x[0] <= 0.05; })};
    setup.variables = {{"pitch", "bow", DesignVariable::Rotate{{0, 1, 0}, {0, 0, 0}, AngleUnit::degrees}}};
    return setup;
  }
  Region ids(bool (*is_held)(const Vec3&)) const {
    std::vector<PointId> result;
    for (std::size_t i = 0; i < mesh->points.size(); ++i) {
      if (is_held(mesh->points[i] / unit)) result.push_back(static_cast<PointId>(i));
    }
    return {Region::Ids{std::move(result)}};
  }

  /// The same with points of its own for each face, each off by normally distributed noise of this size (of `unit`).
  void unweld(double noise) {
    std::mt19937_64 random(5);
    std::normal_distribution<double> normal;
    std::vector<Vec3> points;
    for (PointId& id : mesh->face_points) {
      const Vec3 off{normal(random), normal(random), normal(random)};
      points.push_back(mesh->points[id] + unit * noise * off);
      id = static_cast<PointId>(points.size() - 1);
    }
    mesh->points = std::move(points);
  }
};

struct Moved {
  std::vector<Vec3> by;  ///< in the unit
  double largest = 0, prescribed = 0;
  DesignReport report;
};

Moved moved(const HalfHull& hull, const Setup& setup) {
  const auto system = prepare(hull.mesh, setup, {});
  const Design design{{5}, {}};
  const Points points = system->evaluate(design);
  Moved result;
  for (std::size_t i = 0; i < points.size(); ++i) {
    result.by.push_back((points[i] - hull.mesh->points[i]) / hull.unit);
    result.largest = std::max(result.largest, norm(result.by.back()));
  }
  result.report = system->bind({&design, 1}, EvaluationPath::automatic, {})->report(0);
  result.prescribed = result.report.prescribed_displacement / hull.unit;
  return result;
}

double difference(const Moved& a, const Moved& b) {
  double result = 0;
  for (std::size_t i = 0; i < a.by.size(); ++i) result = std::max(result, norm(a.by[i] - b.by[i]));
  return result;
}

std::vector<MethodOptions> energies() {
  MlsOptions mls;
  mls.surface_samples = 300;
  mls.volume_samples = 100;
  SubspaceOptions subspace;
  subspace.centres = 200;
  return {subspace, mls};
}

Setup symmetric(Setup setup) {
  setup.symmetry = {{SymmetryPlane::Plane{{0, 0, 0}, {0, 1, 0}}}};
  return setup;
}

std::string figures(const MethodOptions& method, double apart, const Moved& got, double off) {
  char text[160];
  std::snprintf(text, sizeof text, "method %zu, apart %g: off by %.2g of %.2g, told %.2g", method.index(), apart, off,
                got.prescribed, got.report.error);
  return text;
}

TEST(NearPoints, stems_beside_the_symmetry_plane_move_as_those_on_it) {
  for (const auto& [nx, unit] : {std::pair<std::size_t, double>{60, 1}, {60, 1000}, {84, 1}}) {
    const auto of = [&](double beside) {
      const HalfHull hull(nx, nx / 5, unit, beside);
      return moved(hull, symmetric(hull.setup(FfdOptions())));
    };
    const Moved on = of(0);
    EXPECT_LT(on.largest, 1.2 * on.prescribed);
    for (const double beside : {1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4}) {
      const Moved got = of(beside);
      const double off = difference(got, on);
      EXPECT_LT(off, (1e-6 + 2 * beside) * on.prescribed) << figures(FfdOptions(), beside, got, off);
      EXPECT_LT(got.report.error, 1e-7 * unit) << figures(FfdOptions(), beside, got, off);
    }
  }
}

// The centres of subspaces and the samples of mls are chosen from all points, with the images, so that other ones are chosen.
TEST(NearPoints, stems_beside_the_symmetry_plane_change_the_choice_of_centres_only) {
  for (const MethodOptions& method : energies()) {
    const auto of = [&](double beside) {
      const HalfHull hull(60, 12, 1, beside);
      return moved(hull, symmetric(hull.setup(method)));
    };
    const Moved on = of(0);
    for (const double beside : {1e-8, 1e-6, 1e-4}) {
      const Moved got = of(beside);
      const double off = difference(got, on);
      EXPECT_LT(off, 2e-3 * on.prescribed) << figures(method, beside, got, off);
      EXPECT_LT(got.report.error, 1e-8) << figures(method, beside, got, off);
    }
  }
}

TEST(NearPoints, patches_that_are_not_welded_move_as_those_that_are) {
  const HalfHull welded(40, 8, 1, 0);
  const Moved whole = moved(welded, welded.setup(FfdOptions()));
  for (const double noise : {0.0, 1e-12, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5}) {
    HalfHull hull(40, 8, 1, 0);
    hull.unweld(noise);
    const Moved got = moved(hull, hull.setup(FfdOptions()));
    double off = 0;
    for (std::size_t i = 0; i < got.by.size(); ++i) off = std::max(off, norm(got.by[i] - whole.by[welded.mesh->face_points[i]]));
    EXPECT_LT(off, 1e-9 * whole.prescribed + 2 * noise) << figures(FfdOptions(), noise, got, off);
  }
}

// Those of before have a centre for each point and count each one: what that loses is told.
TEST(NearPoints, stored_systems_keep_their_results_and_tell_their_errors) {
  FfdOptions options;
  options.misfit = MisfitRule::centres;
  const auto of = [&](double beside) {
    const HalfHull hull(60, 12, 1, beside);
    return moved(hull, symmetric(hull.setup(options)));
  };
  const Moved on = of(0);
  EXPECT_LT(on.report.error, 1e-8);
  for (const double beside : {1e-8, 1e-7}) {
    const Moved got = of(beside);
    const double off = difference(got, on);
    EXPECT_GT(off, 0.1 * on.prescribed) << figures(options, beside, got, off);
    EXPECT_GE(got.report.error, 0.5 * off) << figures(options, beside, got, off);
  }
  const HalfHull welded(40, 8, 1, 0);
  HalfHull soup(40, 8, 1, 0);
  soup.unweld(0);
  const Moved whole = moved(welded, welded.setup(options)), parts = moved(soup, soup.setup(options));
  double off = 0;
  for (std::size_t i = 0; i < parts.by.size(); ++i) {
    off = std::max(off, norm(parts.by[i] - whole.by[welded.mesh->face_points[i]]));
  }
  EXPECT_GT(off, 1e-5 * whole.prescribed);
}

}  // namespace
}  // namespace deform::test::near_points_test
