// SPDX-License-Identifier: GPL-3.0-or-later
// Models far from the origin. What is prescribed keeps its digits there: a rounding of positions, thousands of times larger than
// that of displacements, would be multiplied by interpolants that swing.
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <memory>
#include <vector>

#include "core/deformers/system.h"
#include "tests/core/deformers/dense_interpolant.h"

namespace deform::far_model_test {
namespace {

using test::Wide;
using test::WideVec;

/// Three small patches of held points and a row of free ones around them.
struct Model {
  std::vector<Vec3> points;
  std::vector<PointId> turned, shifted, fixed, free;
};

Model model(const Vec3& place) {
  Model result;
  const auto add = [&](const Vec3& x, std::vector<PointId>& to) {
    to.push_back(static_cast<PointId>(result.points.size()));
    result.points.push_back(x + place);
  };
  std::vector<PointId>* const patches[] = {&result.turned, &result.shifted, &result.fixed};
  for (std::size_t p = 0; p < 3; ++p) {
    for (int i = 0; i < 6; ++i) {
      for (int j = 0; j < 6; ++j) {
        const double u = 0.03 * i, v = 0.03 * j, bend = 0.1 * std::sin(7 * u + 3 * v + static_cast<double>(p));
        add({0.4 * static_cast<double>(p) + u, v, bend}, *patches[p]);
      }
    }
  }
  for (int i = 0; i < 60; ++i) add({-0.2 + 0.025 * i, 0.35 * std::sin(i), 0.3 * std::cos(2 * i)}, result.free);
  return result;
}

constexpr Affine about(double angle, const Vec3& centre) {
  const double c = 1 - angle * angle / 2, s = angle;  // a rotation and a little stretch
  Affine map{c, -s, 0, 0, s, c, 0, 0, 0, 0, 1, 0};
  map[3] = centre[0] - c * centre[0] + s * centre[1];
  map[7] = centre[1] - s * centre[0] - c * centre[1];
  return map;
}

TEST(FarModel, RoundingOfPositionsIsNotMultipliedByTheInterpolant) {
  const Vec3 place{900, -700, 500};
  const Model given = model(place);
  Mesh mesh;
  mesh.points = given.points;
  deform::Setup setup;
  RbfOptions options;
  options.kernel = Kernel::triharmonic;
  options.reduction = CentreReduction::off;
  options.basis = BasisMode::never;
  setup.method = options;
  setup.handles = {{"turned", {Region::Ids{given.turned}}}, {"shifted", {Region::Ids{given.shifted}}}};
  setup.fixed = {{Region::Ids{given.fixed}}};
  const auto system = prepare(std::make_shared<const Mesh>(mesh), setup);
  Design design;
  const Affine turn = about(0.3, place);
  const std::vector<Vec3> shifts(given.shifted.size(), Vec3{0.01, 0.02, -0.03});
  design.motions = {{0, turn}, {1, shifts}};

  test::DenseInterpolant::Problem problem;
  problem.kernel = Kernel::triharmonic;
  problem.degree = 1;
  std::vector<WideVec> data;
  for (const PointId id : given.turned) {
    const WideVec x = test::wide(given.points[id]);
    problem.centres.push_back(x);
    WideVec u;
    for (std::size_t k = 0; k < 3; ++k) {
      u[k] = Wide(turn[4 * k + 3]) - x[k];
      for (std::size_t l = 0; l < 3; ++l) u[k] += Wide(turn[4 * k + l]) * x[l];
    }
    data.push_back(u);
  }
  for (const PointId id : given.shifted) {
    problem.centres.push_back(test::wide(given.points[id]));
    data.push_back(test::wide(shifts[0]));
  }
  for (const PointId id : given.fixed) {
    problem.centres.push_back(test::wide(given.points[id]));
    data.emplace_back();
  }
  test::DenseInterpolant oracle(problem);
  ASSERT_TRUE(oracle.solve(data));

  const Points delivered = system->evaluate(design);
  double largest = 0;
  for (const PointId id : given.free) {
    const WideVec exact = oracle.value(test::wide(given.points[id]));
    WideVec off;
    for (std::size_t k = 0; k < 3; ++k) off[k] = test::exact_sum(delivered[id][k], -given.points[id][k]) - exact[k];
    largest = std::max(largest, static_cast<double>(length(off)));
  }
  // A few times half a unit in the last place of coordinates between 256 and 1024. With the difference of positions it is 20
  // times.
  constexpr double rounding = 0.5 * 0x1p-43;
  EXPECT_LE(largest, 4 * rounding);
}

}  // namespace
}  // namespace deform::far_model_test
