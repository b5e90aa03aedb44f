// SPDX-License-Identifier: GPL-3.0-or-later
// Gauss-Newton matrices against dense ones, with the parameters of the shapes taken out by a decomposition; and the rows of
// points that are delivered.
#include "core/deformers/constrained/gauss_newton.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <random>

#include "core/constraints/constraint.h"
#include "core/deformers/constrained/global_step.h"
#include "tests/support/linear_algebra.h"

namespace deform::gauss_newton_test {
namespace {

ConstraintSet plain_set(const ConstraintKind& kind, PointId first, PointId end, double weight, std::mt19937& random) {
  std::uniform_real_distribution<double> value(-1, 1);
  ConstraintSet set;
  for (PointId id = first; id < end; ++id) {
    set.ids.push_back(id);
    set.rest.push_back({value(random), value(random), value(random)});
  }
  set.projection = make_projection(kind, std::vector<std::vector<Vec3>>{set.rest}, {});
  set.weight = weight;
  return set;
}

/// (S + J^T G (I - P P^+) J)^-1 b with the distances J of the points along their normals: minimal over the parameters P.
Eigen::MatrixXd dense_inverse(const Eigen::MatrixXd& S, const Eigen::MatrixXd& phi, const std::vector<ConstraintSet>& sets,
                              const std::vector<Vec3>& points, const std::vector<ShapeParameters>& shapes,
                              const Eigen::MatrixXd& b) {
  const Eigen::Index r = S.rows();
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(3 * r, 3 * r);
  for (Eigen::Index a = 0; a < 3; ++a) H.block(a * r, a * r, r, r) = S;
  std::size_t first = 0;
  for (std::size_t t = 0; t < sets.size(); ++t) {
    const std::size_t n = sets[t].ids.size();
    const Linearization linear = sets[t].projection->linearize({points.data() + first, n}, shapes[t]);
    const auto rows = static_cast<Eigen::Index>(linear.normals.size());
    Eigen::MatrixXd J(rows, 3 * r);
    for (Eigen::Index row = 0; row < rows; ++row) {
      const auto point = static_cast<Eigen::Index>(first + static_cast<std::size_t>(row) / linear.rows_per_point);
      for (Eigen::Index a = 0; a < 3; ++a) {
        J.block(row, a * r, 1, r) = linear.normals[static_cast<std::size_t>(row)][static_cast<std::size_t>(a)] * phi.row(point);
      }
    }
    if (linear.parameters.cols() > 0) {
      const test::ThinSvd<double> svd = test::thin_svd(linear.parameters);
      Eigen::MatrixXd U = svd.U;
      for (Eigen::Index j = 0; j < U.cols(); ++j) {
        if (svd.values[j] < 1e-9 * svd.values[0]) U.col(j).setZero();
      }
      J -= U * (U.transpose() * J);
    }
    H += sets[t].weight / static_cast<double>(n) * J.transpose() * J;
    first += n;
  }
  const Eigen::VectorXd x = test::ldlt_solution(H, Eigen::Map<const Eigen::VectorXd>(b.data(), b.size()));
  return Eigen::Map<const Eigen::MatrixXd>(x.data(), r, 3);
}

struct DenseCase {
  std::int64_t functions;
  PointId points;
  NewtonForm form;
};

class GaussNewtonOfDenseRows : public testing::TestWithParam<DenseCase> {};

/// Without the squares of the distances the inverse would be that of the energy alone.
TEST_P(GaussNewtonOfDenseRows, IsTheDenseInverse) {
  const auto [functions, points, form] = GetParam();
  std::mt19937 random(5);
  const auto value = [&] { return std::uniform_real_distribution<double>(-1, 1)(random); };
  EnergySolver::Problem problem;
  problem.energy = SparseMatrix(functions, functions);
  for (std::int64_t i = 0; i < functions; ++i) {
    problem.energy.insert(i, i) = 3 + value();
    if (i + 1 < functions) problem.energy.insert(i + 1, i) = value();
  }
  problem.coupling = SparseMatrix(functions, 0);
  const EnergySolver solver(problem, 0, {});
  SparseRows values(points, functions);
  DeliveredRows delivered;
  for (std::int64_t j = 0; j < functions; j += 2) delivered.functions.push_back(j);
  const auto is_held = [](PointId id) { return id % 5 == 0; };
  for (PointId i = 0; i < points; ++i) {
    if (!is_held(i)) delivered.ids.push_back(i);
  }
  delivered.interpolated = Eigen::MatrixXd::NullaryExpr(static_cast<Eigen::Index>(delivered.ids.size()),
                                                        static_cast<Eigen::Index>(delivered.functions.size()), value);
  Eigen::MatrixXd phi = Eigen::MatrixXd::Zero(points, functions);
  for (PointId i = 0; i < points; ++i) {
    const auto place = std::lower_bound(delivered.ids.begin(), delivered.ids.end(), i) - delivered.ids.begin();
    for (std::int64_t j = 0; j < functions; ++j) {
      const double own = value();
      values.insert(i, j) = own;
      if (!is_held(i)) phi(i, j) = own - (j % 2 == 0 ? delivered.interpolated(place, j / 2) : 0.0);
    }
  }
  // Curves have two distances for each point, rigid sets three.
  const std::vector<ConstraintSet> sets{plain_set(Planar{}, 0, points / 2, 40, random),
                                        plain_set(Straight{}, points / 3, 2 * points / 3, 7, random),
                                        plain_set(FixedPlane{{0, 0, 0.1}, {0, 1, 1}}, points / 2, points, 11, random)};
  const ReducedEnergy energy(solver, functions_reaching(values, sets, &delivered), 0, {});
  const ConstrainedPoints constrained(sets, values, energy, &delivered);
  const GlobalStep step(constrained, energy, 0, {});
  const GaussNewton newton(constrained, energy, step.factor(), 0, {});
  ASSERT_EQ(newton.form(), form);
  std::vector<Vec3> at, onto(constrained.count());
  Eigen::MatrixXd rows(static_cast<Eigen::Index>(constrained.count()), functions);
  std::vector<ShapeParameters> shapes(sets.size());
  for (std::size_t t = 0; t < sets.size(); ++t) {
    for (std::size_t i = 0; i < sets[t].ids.size(); ++i) {
      rows.row(static_cast<Eigen::Index>(at.size())) = phi.row(sets[t].ids[i]);
      at.push_back({sets[t].rest[i][0] + 0.1 * value(), sets[t].rest[i][1] + 0.1 * value(), sets[t].rest[i][2]});
    }
    const std::size_t first = constrained.first(t), n = constrained.size(t);
    sets[t].projection->project({at.data() + first, n}, {onto.data() + first, n}, shapes[t]);
  }
  const auto matrix = newton.at(at, shapes, {});
  ASSERT_NE(matrix, nullptr);
  const Eigen::MatrixXd b = Eigen::MatrixXd::NullaryExpr(functions, 3, value);
  const Eigen::MatrixXd S = Eigen::MatrixXd(problem.energy).selfadjointView<Eigen::Lower>();
  const Eigen::MatrixXd expected = dense_inverse(S, rows, sets, at, shapes, b);
  EXPECT_LE((matrix->inverse(b) - expected).norm(), 1e-6 * expected.norm());
  const Eigen::MatrixXd of_energy = test::ldlt_solution(S, b);
  EXPECT_GE((of_energy - expected).norm(), 0.1 * expected.norm()) << "the sets count";
}

INSTANTIATE_TEST_SUITE_P(Forms, GaussNewtonOfDenseRows,
                         testing::Values(DenseCase{12, 120, NewtonForm::full}, DenseCase{80, 40, NewtonForm::forces}),
                         [](const auto& of) { return of.param.form == NewtonForm::full ? "full" : "forces"; });

/// Held points follow no function: where more of them are held than the interpolation meets, rows of theirs would be what it
/// misses. Points of columns follow the functions alone, held or not.
TEST(DenseProducts, AreThoseOfAnySizes) {
  for (const Eigen::Index k : {0, 1, 31, 32, 33, 100}) {
    for (const Eigen::Index m : {0, 1, 7, 65}) {
      for (const Eigen::Index n : {0, 1, 3, 4, 5, 20}) {
        const Eigen::MatrixXd A = Eigen::MatrixXd::Random(m, k), B = Eigen::MatrixXd::Random(k, n),
                              C = Eigen::MatrixXd::Random(m, n);
        const Eigen::MatrixXd product = dense_product(A, B), transposed = transposed_product(A, C);
        ASSERT_EQ(product.rows(), m);
        ASSERT_EQ(product.cols(), n);
        ASSERT_EQ(transposed.rows(), k);
        ASSERT_EQ(transposed.cols(), n);
        if (n == 0) continue;
        for (Eigen::Index i = 0; i < m; ++i) {
          for (Eigen::Index j = 0; j < n; ++j) {
            double sum = 0;
            for (Eigen::Index l = 0; l < k; ++l) sum += A(i, l) * B(l, j);
            EXPECT_NEAR(product(i, j), sum, 1e-13) << m << " " << k << " " << n;
          }
        }
        for (Eigen::Index l = 0; l < k; ++l) {
          for (Eigen::Index j = 0; j < n; ++j) {
            double sum = 0;
            for (Eigen::Index i = 0; i < m; ++i) sum += A(i, l) * C(i, j);
            EXPECT_NEAR(transposed(l, j), sum, 1e-13) << m << " " << k << " " << n;
          }
        }
      }
    }
  }
}

TEST(DeliveredRows, HaveNoHeldPoints) {
  std::mt19937 random(6);
  std::vector<ConstraintSet> sets{plain_set(Planar{}, 10, 20, 1, random), plain_set(Planar{}, 15, 25, 1, random),
                                  plain_set(Rigid{}, 30, 38, 1, random)};
  sets[2].rest = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0, 0, 0.1}, {1, 0, 0.1}, {1, 1, 0.1}, {0, 1, 0.1}};
  sets[2].column = std::make_shared<const StretchedColumn>(StretchedColumn::Corners{4, {0, 1, 2, 3, 4, 5, 6, 7}}, sets[2].rest);
  std::vector<bool> held(40, false);
  for (const PointId id : {3, 11, 17, 24, 31}) held[static_cast<std::size_t>(id)] = true;
  DeliveredRows rows;
  rows.take_points(sets, held);
  EXPECT_EQ(rows.ids, (std::vector<PointId>{10, 12, 13, 14, 15, 16, 18, 19, 20, 21, 22, 23}));
  EXPECT_EQ(rows.columns, (std::vector<PointId>{30, 31, 32, 33, 34, 35, 36, 37}));
  EXPECT_EQ(rows.points(), 20u);
  EXPECT_EQ(rows.row_of(sets[0], 12), 1u);
  EXPECT_EQ(rows.row_of(sets[1], 17), rows.points());
  EXPECT_EQ(rows.row_of(sets[2], 31), 13u);
  EXPECT_EQ(rows.point(13), 31u);
}

}  // namespace
}  // namespace deform::gauss_newton_test
