// SPDX-License-Identifier: GPL-3.0-or-later
// Systems of one sector: against the dense system of all images of its centres.
#include "core/numerics/interpolation/cyclic_interpolator.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "core/numerics/interpolation/dense_interpolator.h"
#include "tests/support/expect_error.h"

namespace deform::cyclic_interpolator_test {
namespace {

struct Wheel {
  Wheel(std::size_t images, int harmonic, std::size_t orbits, std::size_t on_axis) {
    rows.images = images;
    rows.harmonic = harmonic;
    std::mt19937_64 random(images + orbits);
    std::uniform_real_distribution<double> uniform(-1, 1);
    for (std::size_t b = 0; b < orbits; ++b) {
      const bool axis = b < on_axis;
      const double r = axis ? 0 : 0.5 + 0.4 * uniform(random), z = 0.4 * uniform(random), start = uniform(random);
      const std::complex<double> amplitude(uniform(random), uniform(random));
      for (std::size_t k = 0; k < (axis ? 1 : images); ++k) {
        const double turn = 2 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(images);
        centres.push_back({z, r * std::cos(start + turn), r * std::sin(start + turn)});
        const std::complex<double> value = amplitude * std::polar(1.0, harmonic * turn);
        // With two images a vector has the sign of its own only.
        data.push_back(axis && harmonic != 0 ? 0 : value.real());
      }
      rows.first.push_back(static_cast<std::uint32_t>(centres.size()));
    }
  }
  Eigen::MatrixXd F() const { return Eigen::Map<const Eigen::VectorXd>(data.data(), static_cast<Eigen::Index>(data.size())); }

  CyclicRows rows;
  std::vector<Vec3> centres;
  std::vector<double> data;
};

TEST(CyclicInterpolator, IsTheSystemOfAllImages) {
  for (const std::size_t images : {2, 3, 4, 9}) {
    for (const int harmonic : {0, 1}) {
      for (const std::size_t on_axis : {0, 3}) {
        for (const Kernel kernel : {Kernel::triharmonic, Kernel::biharmonic, Kernel::quintic, Kernel::gaussian}) {
          const Wheel wheel(images, harmonic, 17, on_axis);
          InterpolationOptions options;
          options.kernel = {kernel, 0.3};
          options.polynomial_degree = properties(kernel).default_degree();
          options.solver = Solver::ldlt;
          const CyclicInterpolator cyclic(wheel.centres, wheel.rows, options, {});
          const DenseInterpolator dense(wheel.centres, options, {});
          const Interpolants got = cyclic.interpolate(wheel.F(), 0), expected = dense.interpolate(wheel.F(), 0);
          EXPECT_TRUE(got.converged);
          EXPECT_EQ(got.coefficients.rows(), expected.coefficients.rows());
          const double size = expected.coefficients.cwiseAbs().maxCoeff();
          EXPECT_LT((got.coefficients - expected.coefficients).cwiseAbs().maxCoeff(), 1e-10 * size)
              << images << " images, harmonic " << harmonic << ", " << properties(kernel).name;
          EXPECT_LT(got.uncertainty.cwiseAbs().maxCoeff(), 1e-9 * size);
          EXPECT_EQ(cyclic.representatives().size(), 17u);
          EXPECT_GT(cyclic.condition(), 1);
          EXPECT_LE(cyclic.bytes(), CyclicInterpolator::bytes_for(17, wheel.centres.size(), wheel.rows));

          // The adjoint, for values of this harmonic.
          std::mt19937_64 random(3);
          std::uniform_real_distribution<double> uniform(-1, 1);
          Eigen::MatrixXd B(expected.coefficients.rows(), 2);
          for (Eigen::Index i = 0; i < B.size(); ++i) B.data()[i] = uniform(random);
          const Eigen::MatrixXd one = wheel.F().transpose() * cyclic.adjoint(B);
          const Eigen::MatrixXd other = wheel.F().transpose() * dense.adjoint(B);
          const Eigen::MatrixXd product = got.coefficients.transpose() * B;
          EXPECT_LT((one - other).cwiseAbs().maxCoeff(), 1e-9 * (1 + other.cwiseAbs().maxCoeff()));
          EXPECT_LT((one - product).cwiseAbs().maxCoeff(), 1e-9 * (1 + other.cwiseAbs().maxCoeff()));
        }
      }
    }
  }
}

TEST(CyclicInterpolator, IgnoresOtherHarmonics) {
  const Wheel wheel(5, 1, 12, 0), constant(5, 0, 12, 0);
  InterpolationOptions options;
  options.solver = Solver::ldlt;
  const CyclicInterpolator cyclic(wheel.centres, wheel.rows, options, {});
  const Eigen::MatrixXd alone = cyclic.interpolate(wheel.F(), 0).coefficients;
  const Eigen::MatrixXd together = cyclic.interpolate(wheel.F() + constant.F(), 0).coefficients;
  EXPECT_LT((alone - together).cwiseAbs().maxCoeff(), 1e-11 * alone.cwiseAbs().maxCoeff());
}

// Quadratics on a cylinder: one of them depends on the others there, and what is left does not repeat off it.
TEST(CyclicInterpolator, RefusesPolynomialsThatDoNotRepeat) {
  Wheel wheel(3, 0, 8, 0);
  for (Vec3& x : wheel.centres) {
    const double r = std::hypot(x[1], x[2]);
    x = {x[0], x[1] / r, x[2] / r};
  }
  InterpolationOptions options;
  options.solver = Solver::ldlt;
  options.kernel.kernel = Kernel::quintic;
  options.polynomial_degree = 2;
  test::expect_error(ErrorCode::numerical_failure, {"polynomials", "polynomial_degree"},
                     [&] { CyclicInterpolator(wheel.centres, wheel.rows, options, {}); });
}

TEST(CyclicInterpolator, SaysThatCentresCoincide) {
  Wheel wheel(3, 0, 8, 0);
  for (std::size_t k = 0; k < 3; ++k) wheel.centres[3 + k] = wheel.centres[k];
  InterpolationOptions options;
  options.solver = Solver::ldlt;
  Interpolants got;
  try {
    got = CyclicInterpolator(wheel.centres, wheel.rows, options, {}).interpolate(wheel.F(), 0);
    EXPECT_FALSE(got.converged);
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::numerical_failure);
  }
}

}  // namespace
}  // namespace deform::cyclic_interpolator_test
