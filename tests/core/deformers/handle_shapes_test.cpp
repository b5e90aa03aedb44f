// SPDX-License-Identifier: GPL-3.0-or-later
// Which motions mirror or flatten a handle, against determinants and singular values of Eigen, and what is said about them.
#include "core/deformers/handle_shapes.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <random>

#include "core/compiled/motion.h"
#include "tests/support/expect_error.h"

namespace deform::handle_shapes_test {
namespace {

using compiled::Shape;
using compiled::shape_under;
using Texts = std::vector<std::string>;

Affine affine(const Eigen::Matrix3d& A) {
  Affine map{};
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) map[static_cast<std::size_t>(4 * i + j)] = A(i, j);
    map[static_cast<std::size_t>(4 * i + 3)] = 7 - i;
  }
  return map;
}

TEST(HandleShapes, AreThoseOfDeterminantsAndSingularValues) {
  std::mt19937_64 random(8);
  std::normal_distribution<double> normal;
  const auto some = [&] { return Eigen::Matrix3d::NullaryExpr([&] { return normal(random); }).eval(); };
  std::size_t mirrored = 0;
  for (const double size : {1.0, 1e-200, 1e200}) {
    for (int k = 0; k < 200; ++k) {
      const Eigen::Matrix3d A = some();
      const Shape shape = shape_under(affine(size * A));
      EXPECT_EQ(shape, A.determinant() < 0 ? Shape::mirrored : Shape::kept) << size << "\n" << A;
      mirrored += shape == Shape::mirrored ? 1 : 0;
      // A map of known singular values. The norms make the limit 1 to 3 times 1e-6.
      const Eigen::Matrix3d U = Eigen::HouseholderQR<Eigen::Matrix3d>(some()).householderQ();
      const Eigen::Matrix3d V = Eigen::HouseholderQR<Eigen::Matrix3d>(some()).householderQ();
      const double middle = std::pow(10.0, -6 * std::abs(std::sin(k)));
      for (const double least : {0.0, 1e-9, 0.9e-6}) {
        const Eigen::Vector3d values = size * Eigen::Vector3d(1, std::max(middle, least), least);
        EXPECT_EQ(shape_under(affine(U * values.asDiagonal() * V)), Shape::flattened) << size << " " << least;
      }
      const Eigen::Matrix3d thin = U * Eigen::Vector3d(1, std::max(middle, 3.1e-6), 3.1e-6).asDiagonal() * V;
      EXPECT_EQ(shape_under(affine(size * thin)), U.determinant() * V.determinant() < 0 ? Shape::mirrored : Shape::kept);
    }
  }
  EXPECT_GT(mirrored, 200u);
  EXPECT_LT(mirrored, 400u);
  EXPECT_EQ(shape_under(affine(Eigen::Matrix3d::Zero())), Shape::flattened);
  EXPECT_EQ(shape_under(affine(Eigen::Vector3d(1, 0, 0).asDiagonal())), Shape::flattened) << "onto a line";
  EXPECT_EQ(shape_under(identity_affine), Shape::kept);
}

deform::Setup scaled_setup() {
  deform::Setup setup;
  for (const char* name : {"root", "tip", "tail", "fin", "nose"}) setup.handles.push_back({name, {}});
  setup.variables = {{"fat", "root", DesignVariable::Scale{{1, 2, 3}, {0, 0, 1}}},
                     {"turn", "root", DesignVariable::Rotate{{1, 1, 0}, {0, 0, 0}}},
                     {"big", "tip", DesignVariable::Scale{{0, 0, 0}, {0, 0, 0}}},
                     {"long", "root", DesignVariable::Scale{{0, 0, 0}, {1, 0, 0}}}};
  setup.variables[2].also = {{"tail", DesignVariable::Scale{{5, 0, 0}, {0, 1, 0}}}};
  return setup;
}

TEST(HandleShapes, NameTheHandleTheScalesAndTheDeterminant) {
  const deform::Setup setup = scaled_setup();
  const auto doubts = [&](std::vector<double> variables) { return handle_shape_doubts(setup, {std::move(variables), {}}); };
  EXPECT_EQ(doubts({}), Texts{});
  EXPECT_EQ(doubts({0, 40, 0, 0}), Texts{}) << "nothing is scaled";
  EXPECT_EQ(doubts({-0.999, 3, 8, 0.5}), Texts{});
  EXPECT_EQ(doubts({-3, 0.4, 0, 0}), Texts{"handle \"root\" is mirrored by fat = -3: its linear map has determinant -2"});
  EXPECT_EQ(doubts({-1, 0.4, 0, 0.5}),
            Texts{"handle \"root\" is flattened by fat = -1, long = 0.5: its linear map has determinant 0"});
  EXPECT_EQ(doubts({-3, 0.4, 0, -2}), Texts{}) << "mirrored twice is turned";
  EXPECT_EQ(doubts({0, 0, -3, 0}), (Texts{"handle \"tip\" is mirrored by big = -3: its linear map has determinant -8",
                                          "handle \"tail\" is mirrored by big = -3: its linear map has determinant -2"}));
  test::expect_error(ErrorCode::invalid_argument, {"expected 4", "got 1"}, [&] { doubts({-3}); });
}

TEST(HandleShapes, OfMapsThatAreGivenAndNotOfDisplacements) {
  const deform::Setup setup = scaled_setup();
  const Affine mirror = affine(Eigen::Vector3d(1, -0.5, 1).asDiagonal());
  EXPECT_EQ(handle_shape_doubts(setup, {{}, {{1, mirror}, {2, std::vector<Vec3>(4)}, {3, identity_affine}}}),
            Texts{"handle \"tip\" is mirrored: its linear map has determinant -0.5"});
  EXPECT_EQ(handle_shape_doubts(setup, {{-3, 0, 0, 0}, {{1, mirror}}}).size(), 2u);
  const Texts all = handle_shape_doubts(setup, {{}, {{0, mirror}, {1, mirror}, {2, mirror}, {3, mirror}, {4, mirror}}});
  ASSERT_EQ(all.size(), 4u);
  EXPECT_EQ(all[3], "2 handles more are mirrored or flattened");
}

}  // namespace
}  // namespace deform::handle_shapes_test
