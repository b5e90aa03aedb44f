// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/lattice/refinement.h"

#include <gtest/gtest.h>

#include <numeric>
#include <random>

#include "core/base/vectors.h"
#include "tests/support/expect_error.h"

namespace deform::refinement_test {
namespace {

struct Case {
  LatticeBasis basis;
  std::array<std::size_t, 3> points;
  std::array<bool, 3> axes;
  std::array<std::size_t, 3> expected;
};

const std::vector<Case> cases{
    {LatticeBasis::uniform_cubic, {4, 7, 5}, {true, true, true}, {5, 11, 7}},
    {LatticeBasis::uniform_cubic, {6, 4, 9}, {false, false, true}, {6, 4, 15}},
    {LatticeBasis::clamped_cubic, {4, 5, 8}, {true, true, true}, {5, 7, 13}},
    {LatticeBasis::clamped_cubic, {11, 4, 4}, {true, false, false}, {19, 4, 4}},
    {LatticeBasis::bernstein, {2, 7, 15}, {true, true, true}, {3, 8, 16}},
    {LatticeBasis::bernstein, {3, 4, 5}, {false, true, false}, {3, 5, 5}},
};

const LatticeFrame turned{{1, -2, 3}, {{{2, 1, 0}, {-1, 2, 0.5}, {0.25, 0, 3}}}};

TEST(LatticeRefinement, GivesTheSameSumsEverywhere) {
  std::mt19937_64 random(17);
  std::uniform_real_distribution<double> uniform(0, 1);
  for (const Case& c : cases) {
    const Lattice coarse(turned, c.points, c.basis);
    const LatticeRefinement refinement(coarse, c.basis, c.axes);
    const Lattice& fine = refinement.fine();
    for (std::size_t k = 0; k < 3; ++k) EXPECT_EQ(fine.axis(k).size(), c.expected[k]);
    std::vector<Vec3> values(coarse.size());
    for (Vec3& value : values) value = {uniform(random), 2 * uniform(random) - 1, uniform(random)};
    const std::vector<Vec3> refined = refinement.refined(values);
    ASSERT_EQ(refined.size(), fine.size());
    for (int i = 0; i < 500; ++i) {
      Vec3 u{uniform(random), uniform(random), uniform(random)};
      if (i < 8) u = {double(i & 1), double(i >> 1 & 1), double(i >> 2 & 1)};
      for (const std::array<std::size_t, 3>& derivative :
           {std::array<std::size_t, 3>{0, 0, 0}, std::array<std::size_t, 3>{1, 0, 1}}) {
        const Vec3 expected = coarse.sum(values, u, derivative), got = fine.sum(refined, u, derivative);
        ASSERT_LE(distance(got, expected), 1e-14 * (derivative[0] == 0 ? 1 : 1000));
      }
    }
    // The control points at rest of one are those of the other.
    const std::vector<Vec3> rest = refinement.refined(coarse.control_points()), own = fine.control_points();
    for (std::size_t p = 0; p < rest.size(); ++p) ASSERT_LE(distance(rest[p], own[p]), 1e-14 * 10);
  }
}

TEST(LatticeRefinement, IsThatOfLaneAndRiesenfeldForUniformKnots) {
  const AxisRefinement axis(LatticeBasis::uniform_cubic, SplineAxis(LatticeBasis::uniform_cubic, 8));
  for (std::size_t i = 0; i < axis.fine().size(); ++i) {
    std::vector<double> expected(8, 0.0), got(8, 0.0);
    if (i % 2 == 0) {
      expected[i / 2] = expected[i / 2 + 1] = 0.5;
    } else {
      expected[i / 2] = expected[i / 2 + 2] = 0.125;
      expected[i / 2 + 1] = 0.75;
    }
    const AxisRefinement::Row& row = axis.row(i);
    for (std::size_t j = 0; j < row.weights.size(); ++j) got[row.first + j] = row.weights[j];
    for (std::size_t j = 0; j < 8; ++j) EXPECT_NEAR(got[j], expected[j], 1e-15) << i << " " << j;
  }
}

TEST(LatticeRefinement, EveryControlPointHasOneThatStandsForItAlone) {
  for (const LatticeBasis basis : {LatticeBasis::uniform_cubic, LatticeBasis::clamped_cubic, LatticeBasis::bernstein}) {
    for (std::size_t n = basis == LatticeBasis::bernstein ? 2 : 4; n < 16; ++n) {
      const AxisRefinement axis(basis, SplineAxis(basis, n));
      const std::size_t count = axis.fine().size();
      std::vector<int> alone(n, 0);
      for (std::size_t i = 0; i < count; ++i) {
        ASSERT_FALSE(axis.parents(i).empty());
        if (axis.parents(i).size() == 1) alone[axis.parents(i)[0]] = 1;
        // The same from the other end.
        std::vector<std::size_t> mirrored = axis.parents(count - 1 - i);
        for (std::size_t& parent : mirrored) parent = n - 1 - parent;
        std::reverse(mirrored.begin(), mirrored.end());
        EXPECT_EQ(axis.parents(i), mirrored) << n << " " << i;
      }
      EXPECT_EQ(std::accumulate(alone.begin(), alone.end(), std::size_t{0}), n);
    }
  }
}

TEST(LatticeRefinement, MapsSelections) {
  const Lattice coarse({}, {6, 4, 4}, LatticeBasis::uniform_cubic);
  const LatticeRefinement refinement(coarse, LatticeBasis::uniform_cubic, {true, false, false});
  // i of 2 and 3 are 3 and 5 of the finer axis, and 4 lies between.
  std::vector<std::size_t> ids, expected;
  for (std::size_t jk = 0; jk < 16; ++jk) {
    for (const std::size_t i : {2, 3}) ids.push_back(i + 6 * jk);
    for (const std::size_t i : {3, 4, 5}) expected.push_back(i + 9 * jk);
  }
  EXPECT_EQ(refinement.refined_selection(ids), expected);
  EXPECT_EQ(refinement.refined_selection(std::vector<std::size_t>{0}), std::vector<std::size_t>{0});
  EXPECT_EQ(refinement.refined_selection(std::vector<std::size_t>{2, 4}), (std::vector<std::size_t>{3, 7}));
  std::vector<std::size_t> all(coarse.size());
  std::iota(all.begin(), all.end(), std::size_t{0});
  EXPECT_EQ(refinement.refined_selection(all).size(), refinement.fine().size());
}

TEST(LatticeRefinement, RefusesWhatCannotBe) {
  const Lattice most({}, {16, 4, 4}, LatticeBasis::bernstein);
  test::expect_error(ErrorCode::invalid_argument, {"16", "Bernstein"}, [&] {
    const LatticeRefinement refinement(most, LatticeBasis::bernstein, {true, false, false});
  });
  const LatticeRefinement refinement(most, LatticeBasis::bernstein, {false, true, true});
  test::expect_error(ErrorCode::invalid_argument, {"3 values", "256"}, [&] { (void)refinement.refined(std::vector<Vec3>(3)); });
}

}  // namespace
}  // namespace deform::refinement_test
