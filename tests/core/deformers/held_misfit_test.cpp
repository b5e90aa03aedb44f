// SPDX-License-Identifier: GPL-3.0-or-later
// What held points miss by themselves, against shapes that are fitted to these points alone.
#include "core/deformers/constrained/held_misfit.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <random>
#include <vector>

#include "core/base/vectors.h"
#include "core/constraints/constraint.h"
#include "core/deformers/methods.h"
#include "tests/core/deformers/energy_cases.h"
#include "tests/support/linear_algebra.h"

namespace deform::test::held_misfit_test {
namespace {

struct Cloud {
  std::vector<Vec3> rest, points;
  std::vector<char> held;
};

/// Points near a bent sheet, of which every third one is held, and these are off by more.
Cloud cloud(std::uint32_t seed, std::size_t count = 60) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> value(-1, 1);
  Cloud result;
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3 at{value(random), value(random), 0.1 * value(random)};
    const bool held = i % 3 == 0;
    result.rest.push_back(at);
    result.held.push_back(held ? 1 : 0);
    const double off = held ? 0.2 : 0.02;
    result.points.push_back(at +
                            Vec3{off * value(random), off * value(random), off * value(random) + (held ? 0.3 * at[0] : 0.0)});
  }
  return result;
}

Projection::Misfit misfit_of(const ConstraintKind& kind, const Cloud& of, std::vector<std::vector<Vec3>> rest = {}) {
  if (rest.empty()) rest = {of.rest};
  return held_misfit(*make_projection(kind, rest), of.points, of.held, {});
}

Eigen::MatrixXd held_rows(const std::vector<Vec3>& x, const std::vector<char>& held) {
  Eigen::MatrixXd result(std::count(held.begin(), held.end(), 1), 3);
  Eigen::Index row = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    if (held[i] != 0) result.row(row++) << x[i][0], x[i][1], x[i][2];
  }
  return result;
}

TEST(HeldMisfit, OfAPlaneIsThatOfThePlaneThroughTheHeldPoints) {
  for (std::uint32_t seed = 1; seed <= 5; ++seed) {
    const Cloud of = cloud(seed);
    const Eigen::MatrixXd x = held_rows(of.points, of.held);
    const Eigen::MatrixXd d = x.rowwise() - x.colwise().mean();
    const ThinSvd<double> svd = thin_svd(d);
    const Projection::Misfit got = misfit_of(Planar{}, of);
    EXPECT_EQ(got.count, of.points.size());
    EXPECT_NEAR(std::sqrt(got.squares), svd.values[2], 1e-4 * svd.values[2]) << seed;
    EXPECT_NEAR(got.largest, (d * svd.V.col(2)).cwiseAbs().maxCoeff(), 0.02 * got.largest) << seed;
  }
}

/// Few held points among many others, where the plain alternation hardly moves: 5 of 600.
TEST(HeldMisfit, IsFoundWhereFewPointsAreHeld) {
  Cloud of = cloud(7, 600);
  for (std::size_t i = 0; i < of.held.size(); ++i) of.held[i] = i % 120 == 0 ? 1 : 0;
  const Eigen::MatrixXd x = held_rows(of.points, of.held);
  const Eigen::MatrixXd d = x.rowwise() - x.colwise().mean();
  const double expected = thin_svd(d).values[2];
  EXPECT_NEAR(std::sqrt(misfit_of(Planar{}, of).squares), expected, 0.02 * expected);
}

/// Three points are always in a plane, however far the others are from it.
TEST(HeldMisfit, IsNothingWhereHeldPointsContradictNothing) {
  Cloud of = cloud(8);
  for (std::size_t i = 0; i < of.held.size(); ++i) of.held[i] = i % 20 == 0 ? 1 : 0;
  EXPECT_LT(std::sqrt(misfit_of(Planar{}, of).squares), 1e-3);
  of.held.assign(of.held.size(), 0);
  EXPECT_LT(std::sqrt(misfit_of(Planar{}, of).squares), 1e-3);
}

TEST(HeldMisfit, OfARigidSetIsThatOfTheBestMotionOfTheHeldPoints) {
  const Cloud of = cloud(9);
  const Eigen::MatrixXd from = held_rows(of.rest, of.held), to = held_rows(of.points, of.held);
  const Eigen::MatrixXd a = from.rowwise() - from.colwise().mean(), b = to.rowwise() - to.colwise().mean();
  const ThinSvd<double> svd = thin_svd(a.transpose() * b);
  Eigen::Matrix3d sign = Eigen::Matrix3d::Identity();
  sign(2, 2) = (svd.U * svd.V.transpose()).determinant() < 0 ? -1 : 1;
  const double expected = (a * (svd.U * sign * svd.V.transpose()) - b).norm();
  EXPECT_NEAR(std::sqrt(misfit_of(Rigid{}, of).squares), expected, 1e-3 * expected);
}

/// A given plane does not move; of pairs both points count, so that only those of two held points miss their distance.
TEST(HeldMisfit, OfGivenPlanesAndPairsIsThatOfTheHeldPointsThemselves) {
  const Cloud of = cloud(10);
  double squares = 0, largest = 0;
  for (std::size_t i = 0; i < of.points.size(); ++i) {
    if (of.held[i] == 0) continue;
    const double height = of.points[i][2] - 0.05;
    squares += height * height;
    largest = std::max(largest, std::abs(height));
  }
  const Projection::Misfit plane = misfit_of(FixedPlane{{0, 0, 0.05}, {0, 0, 2}}, of);
  EXPECT_NEAR(plane.squares, squares, 1e-12);
  EXPECT_NEAR(plane.largest, largest, 1e-12);

  // Opposite points of two rows, 1 apart at rest.
  Cloud pairs;
  std::vector<std::vector<Vec3>> rest(2);
  for (std::size_t side = 0; side < 2; ++side) {
    for (std::size_t i = 0; i < 12; ++i) {
      const Vec3 at{3.0 * static_cast<double>(i), 0, static_cast<double>(side)};
      rest[side].push_back(at);
      pairs.points.push_back(at + Vec3{0, 0, side == 0 ? 0.0 : 0.01 * static_cast<double>(i)});
      pairs.held.push_back(i % 2 == 0 || (side == 0 && i % 3 == 0) ? 1 : 0);
    }
  }
  const Projection::Misfit distances = misfit_of(Distance{}, pairs, rest);
  EXPECT_EQ(distances.count, 12u);
  EXPECT_NEAR(distances.largest, 0.1, 1e-6);  // pair 10
  EXPECT_NEAR(distances.squares, 1e-4 * (4 + 16 + 36 + 64 + 100), 1e-6);
}

/// A plane with points of the handle in the middle, which turns.
TEST(HeldMisfit, IsToldWithWhatHolds) {
  const auto mesh = shared(bumpy_sheet(31, 16));
  const std::vector<double> bent{0.1, 0.8, 0.2, -0.6};
  deform::Setup setup = setup_with_variables();
  FfdOptions options;
  options.lattice.points = {9, 7, 4};
  setup.method = options;
  setup.constraints = {{"held", {box({0.85, 0.1, -9}, {1.9, 0.9, 9})}, Planar{}},
                       {"free", {box({1.2, 0.1, -9}, {1.6, 0.9, 9})}, Planar{}}};
  const SelectedRegions regions = validate(setup, *mesh);
  const auto told = [&] {
    const Design design{bent, {}};
    const auto system = prepare(mesh, setup);
    return std::pair(system->bind({&design, 1}, EvaluationPath::automatic, {})->report(0), system->evaluate(design));
  };
  const auto [report, points] = told();
  Cloud of;
  std::vector<std::size_t> counts(setup.handles.size());
  for (const PointId id : regions.constraints[0][0]) {
    of.points.push_back(points[id]);
    of.held.push_back(0);
    for (std::size_t h = 0; h < counts.size(); ++h) {
      if (!std::binary_search(regions.handles[h].begin(), regions.handles[h].end(), id)) continue;
      of.held.back() = 1;
      ++counts[h];
    }
  }
  std::size_t entries = 0;
  for (std::size_t h = 0; h < counts.size(); ++h) {
    if (counts[h] == 0) continue;
    ASSERT_LT(entries, report.constraints[0].held.size());
    EXPECT_EQ(report.constraints[0].held[entries].handle, h);
    EXPECT_EQ(report.constraints[0].held[entries++].points, counts[h]);
  }
  ASSERT_GT(entries, 0u);
  EXPECT_EQ(report.constraints[0].held.size(), entries);
  const Eigen::MatrixXd x = held_rows(of.points, of.held);
  const Eigen::MatrixXd d = x.rowwise() - x.colwise().mean();
  const double expected = thin_svd(d).values[2];
  ASSERT_TRUE(report.constraints[0].held_misfit.has_value());
  const double rms = expected / std::sqrt(static_cast<double>(of.points.size()));
  EXPECT_NEAR(report.constraints[0].held_misfit->rms, rms, 1e-3 * rms);
  EXPECT_LE(report.constraints[0].held_misfit->rms, report.constraints[0].rms);
  EXPECT_TRUE(report.constraints[1].held.empty());
  EXPECT_FALSE(report.constraints[1].held_misfit.has_value());

  // Soft handles hold nothing; a design that meets its shapes needs no reason.
  options.handles = HandleMode::soft;
  setup.method = options;
  EXPECT_TRUE(told().first.constraints[0].held.empty());
}

}  // namespace
}  // namespace deform::test::held_misfit_test
