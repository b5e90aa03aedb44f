// SPDX-License-Identifier: GPL-3.0-or-later
// Linearized distances of sets on common points, of which one is held, against pseudoinverses of dense matrices.
#include "core/deformers/constrained/linearized_sets.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <random>
#include <utility>
#include <vector>

#include "core/base/vectors.h"
#include "core/constraints/constraint.h"

namespace deform::linearized_sets_test {
namespace {

/// Three planes that are given or a plane, a sphere and a cylinder that are fitted, with points in common.
struct Case {
  explicit Case(bool fitted) {
    std::uniform_real_distribution<double> value(-1, 1);
    for (int i = 0; i < 30; ++i) {
      const Vec3 v{value(random), value(random), value(random)};
      points.push_back((1 + 0.02 * value(random)) / std::sqrt(dot(v, v)) * v);
    }
    on.moves.assign(points.size(), true);
    on.moves[held] = false;
    const std::vector<ConstraintKind> kinds =
        fitted ? std::vector<ConstraintKind>{Planar{}, Spherical{}, Cylindrical{}}
               : std::vector<ConstraintKind>{FixedPlane{{0, 0, 0}, {0, 0, 1}}, FixedPlane{{0, 0.1, 0}, {0, 1, 0.3}},
                                             FixedPlane{{0, 0, 0.01}, {0, 0, 1}}};
    const std::pair<std::uint32_t, std::uint32_t> spans[] = {{0, 12}, {8, 30}, {10, 22}};
    sets.resize(3);
    for (std::size_t t = 0; t < 3; ++t) {
      auto& places = on.places.emplace_back();
      for (std::uint32_t i = spans[t].first; i < spans[t].second; ++i) {
        places.push_back(i);
        sets[t].ids.push_back(i);
        sets[t].rest.push_back(points[i]);
      }
      sets[t].projection = make_projection(kinds[t], std::vector<std::vector<Vec3>>{sets[t].rest}, {});
      on.sets.push_back(&sets[t]);
    }
  }

  static constexpr std::size_t held = 11;
  std::mt19937 random{3};
  std::vector<Vec3> points;
  std::vector<ConstraintSet> sets;
  SetsOnPoints on;
};

Eigen::VectorXd flat(const std::vector<Vec3>& v) {
  Eigen::VectorXd result(static_cast<Eigen::Index>(3 * v.size()));
  for (std::size_t i = 0; i < v.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) result[static_cast<Eigen::Index>(3 * i + k)] = v[i][k];
  }
  return result;
}

Eigen::MatrixXd pseudoinverse(const Eigen::MatrixXd& A, Eigen::Index& rank) {
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(A, Eigen::ComputeThinU | Eigen::ComputeThinV);
  Eigen::VectorXd inverse = svd.singularValues();
  rank = 0;
  for (double& value : inverse) {
    const bool counts = value > 1e-9 * svd.singularValues()[0];
    value = counts ? 1 / value : 0;
    rank += counts;
  }
  return svd.matrixV() * inverse.asDiagonal() * svd.matrixU().transpose();
}

TEST(LinearizedSets, AreTheDenseOnes) {
  for (const bool fitted : {false, true}) {
    SCOPED_TRACE(fitted);
    Case c(fitted);
    std::vector<ShapeParameters> shapes(3);
    const LinearizedSets sets(c.on, c.points, shapes, {}, {}, {});
    Eigen::Index rows = 0, parameters = 0;
    std::vector<Linearization> linear;
    for (std::size_t t = 0; t < 3; ++t) {
      linear.push_back(c.sets[t].projection->linearize(c.sets[t].rest, shapes[t]));
      rows += static_cast<Eigen::Index>(linear[t].normals.size());
      parameters += linear[t].parameters.cols();
    }
    ASSERT_EQ(sets.residual().size(), rows);
    const auto n = static_cast<Eigen::Index>(3 * c.points.size());
    Eigen::MatrixXd N = Eigen::MatrixXd::Zero(rows, n), Q = Eigen::MatrixXd::Zero(rows, std::max<Eigen::Index>(1, parameters));
    Eigen::Index row = 0, first = 0;
    for (std::size_t t = 0; t < 3; ++t) {
      const auto count = static_cast<Eigen::Index>(linear[t].normals.size());
      for (Eigen::Index r = 0; r < count; ++r) {
        const auto at = static_cast<std::size_t>(r);
        for (std::size_t k = 0; k < 3; ++k) {
          N(row + r, static_cast<Eigen::Index>(3 * c.on.places[t][at / linear[t].rows_per_point] + k)) = linear[t].normals[at][k];
        }
        EXPECT_NEAR(sets.residual()[row + r], linear[t].residual[r], 1e-14);
      }
      Q.block(row, first, count, linear[t].parameters.cols()) = linear[t].parameters;
      row += count;
      first += linear[t].parameters.cols();
    }
    // What the held point gives, and what the others.
    const auto held = static_cast<Eigen::Index>(3 * Case::held);
    Eigen::MatrixXd still = Eigen::MatrixXd::Zero(rows, n), moving = N;
    still.middleCols(held, 3) = N.middleCols(held, 3);
    moving.middleCols(held, 3).setZero();
    std::vector<Vec3> wanted(c.points.size());
    std::uniform_real_distribution<double> value(-1, 1);
    for (Vec3& v : wanted) v = {value(c.random), value(c.random), value(c.random)};
    const Eigen::VectorXd given = Eigen::VectorXd::NullaryExpr(rows, [&] { return value(c.random); });
    Eigen::Index point_rank = 0, rank = 0;
    pseudoinverse(moving, point_rank);
    EXPECT_EQ(static_cast<Eigen::Index>(sets.point_rank()), point_rank);
    const Eigen::MatrixXd left = Eigen::MatrixXd::Identity(rows, rows) - Q * pseudoinverse(Q, rank);
    const Eigen::MatrixXd inverse = pseudoinverse(left * moving, rank);
    Eigen::VectorXd free = flat(wanted);
    free.segment(held, 3).setZero();
    const Eigen::VectorXd expected = free - inverse * (left * (given + moving * free));
    EXPECT_LT((flat(sets.step(wanted, given)) - expected).norm(), 1e-7 * expected.norm());
    EXPECT_LT((sets.adjoint(wanted) + (inverse * left).transpose() * free).norm(), 1e-7 * free.norm());
    EXPECT_LT((flat(sets.held_adjoint(given)) - still.transpose() * given).norm(), 1e-12);
    EXPECT_LT((sets.held_rows(wanted) - still * flat(wanted)).norm(), 1e-12);
    const std::vector<std::vector<Vec3>> forces = sets.forces(given);
    Eigen::VectorXd sum = Eigen::VectorXd::Zero(n);
    for (std::size_t t = 0; t < 3; ++t) {
      for (std::size_t i = 0; i < forces[t].size(); ++i) {
        for (std::size_t k = 0; k < 3; ++k) sum[static_cast<Eigen::Index>(3 * c.on.places[t][i] + k)] += forces[t][i][k];
      }
    }
    EXPECT_LT((sum - N.transpose() * given).norm(), 1e-12);
  }
}

}  // namespace
}  // namespace deform::linearized_sets_test
