// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/interpolation/interpolator.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/numerics/interpolation/dense_interpolator.h"
#include "core/numerics/interpolation/iterative_interpolator.h"
#include "core/numerics/interpolation/least_squares_interpolator.h"
#include "core/numerics/kernels/residual.h"
#include "core/numerics/kernels/tiles.h"

namespace deform {

Interpolator::Interpolator(std::vector<Vec3> centres, const RadialKernel& kernel, int polynomial_degree)
    : centres_(std::move(centres)), kernel_(kernel), polynomials_(centres_, polynomial_degree, kernel.parity) {}

namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// sums(weights) and the polynomials.
template <typename Sums>
std::vector<double> with_polynomials(const PolynomialSpace& space, const RowMajor& rows, std::span<const Vec3> points,
                                     const RunContext& context, const Sums& sums) {
  const std::span<const double> all(rows.data(), static_cast<std::size_t>(rows.size()));
  const std::size_t polynomials = space.terms() * static_cast<std::size_t>(rows.cols());
  std::vector<double> result = sums(all.first(all.size() - polynomials));
  add_polynomials(space, points, all.last(polynomials), result, context);
  return result;
}

}  // namespace

void add_accurately(const Eigen::MatrixXd& correction, Interpolants& to) {
  Eigen::MatrixXd& rest = to.rest;
  if (rest.size() == 0) rest.setZero(correction.rows(), correction.cols());
  for (Eigen::Index c = 0; c < correction.cols(); ++c) {
    for (Eigen::Index r = 0; r < correction.rows(); ++r) {
      // The sum of two doubles is a double and another one (Knuth).
      const double a = to.coefficients(r, c), b = correction(r, c) + rest(r, c);
      const double sum = a + b, part = sum - a;
      to.coefficients(r, c) = sum;
      rest(r, c) = (a - (sum - part)) + (b - part);
    }
  }
}

const std::vector<std::uint32_t>& Interpolator::representatives() const {
  static const std::vector<std::uint32_t> none;
  return none;
}

std::vector<double> Interpolator::values(const Interpolants& interpolants, std::span<const Vec3> points,
                                         const RunContext& context) const {
  double error = 0;
  return values(interpolants, points, error, context);
}

std::vector<double> Interpolator::values(const Interpolants& interpolants, std::span<const Vec3> points, double& error,
                                         const RunContext& context) const {
  error = 0;
  return with_polynomials(polynomials_, interpolants.coefficients, points, context, [&](std::span<const double> weights) {
    return weighted_sums(interpolants, weights, points, error, context);
  });
}

std::vector<double> Interpolator::direct_values(const Interpolants& interpolants, std::span<const Vec3> points,
                                                const RunContext& context) const {
  double error = 0;
  return with_polynomials(polynomials_, interpolants.coefficients, points, context, [&](std::span<const double> weights) {
    return Interpolator::weighted_sums(interpolants, weights, points, error, context);
  });
}

std::vector<double> Interpolator::weighted_sums(const Interpolants& interpolants, std::span<const double> weights,
                                                std::span<const Vec3> points, double& /*error*/,
                                                const RunContext& context) const {
  const auto columns = static_cast<std::size_t>(interpolants.coefficients.cols());
  return kernel_sums(kernel_, points, weighted_centres(weights.size() / columns), weights, columns, context);
}

Eigen::MatrixXd Interpolator::accurate_residual(const Interpolants& interpolants, std::span<const Vec3> points,
                                                const Eigen::MatrixXd& wanted, const RunContext& context) const {
  const auto weights = static_cast<std::size_t>(interpolants.coefficients.rows()) - polynomials_.terms();
  const Eigen::MatrixXd P = polynomials_.matrix(points);
  const auto left = [&](const Eigen::MatrixXd& coefficients, const Eigen::MatrixXd& from) {
    return deform::accurate_residual(kernel_, points, weighted_centres(weights), P, coefficients, from, context);
  };
  const Eigen::MatrixXd result = left(interpolants.coefficients, wanted);
  return interpolants.rest.size() > 0 ? left(interpolants.rest, result) : result;
}

double Interpolator::rounding(const Interpolants& interpolants, std::span<const Vec3> points, const RunContext& context) const {
  constexpr double unit = std::numeric_limits<double>::epsilon() / 2;
  const RowMajor absolute = interpolants.coefficients.cwiseAbs();
  const auto columns = static_cast<std::size_t>(absolute.cols());
  const std::size_t count = static_cast<std::size_t>(absolute.rows()) - polynomials_.terms();
  const std::span<const double> weights(absolute.data(), count * columns);
  const std::vector<double> sums = kernel_sums(kernel_, points, weighted_centres(count), weights, columns, context);
  const Eigen::MatrixXd terms =
      polynomials_.matrix(points).cwiseAbs() * absolute.bottomRows(static_cast<Eigen::Index>(polynomials_.terms()));
  double largest = terms.size() > 0 ? terms.maxCoeff() : 0.0;
  for (const double sum : sums) largest = std::max(largest, std::abs(sum));
  return unit * largest;
}

std::vector<double> Interpolator::sums_at_centres(std::span<const Vec3> places, std::span<const double> weights,
                                                  std::size_t columns, const RunContext& context) const {
  return kernel_sums(kernel_, centres_, places, weights, columns, context);
}

Eigen::MatrixXd Interpolator::with_side_conditions(const Eigen::MatrixXd& F) const {
  Eigen::MatrixXd B = Eigen::MatrixXd::Zero(F.rows() + static_cast<Eigen::Index>(polynomials_.terms()), F.cols());
  B.topRows(F.rows()) = F;
  return B;
}

std::unique_ptr<const Interpolator> make_interpolator(std::vector<Vec3> centres, const InterpolationOptions& options,
                                                      const RunContext& context) {
  switch (chosen_solver(options.solver, options.kernel.kernel, centres.size())) {
    case Solver::iterative:
      return std::make_unique<IterativeInterpolator>(std::move(centres), options, context);
    case Solver::incremental_qr:
      return std::make_unique<LeastSquaresInterpolator>(std::move(centres), options, context);
    case Solver::automatic:
    case Solver::cholesky:
    case Solver::ldlt:
      break;
  }
  return std::make_unique<DenseInterpolator>(std::move(centres), options, context);
}

std::size_t interpolator_bytes(std::size_t m, Solver solver) {
  if (solver == Solver::iterative) return IterativeInterpolator::bytes_for(m);
  if (solver == Solver::incremental_qr) {
    return LeastSquaresInterpolator::bytes_for(m, std::min<std::size_t>(m, most_incremental_centres));
  }
  return DenseInterpolator::bytes_for(m, solver);
}

std::size_t interpolator_peak_bytes(std::size_t m, Solver solver) {
  if (solver == Solver::iterative) return IterativeInterpolator::peak_bytes(m, 4);
  // In addition to the factor: the samples, their transforms, and a request.
  if (solver == Solver::incremental_qr) {
    return interpolator_bytes(m, solver) + 16 * (m + PolynomialSpace::most_terms) * sizeof(double);
  }
  return DenseInterpolator::peak_bytes(m, solver);
}

}  // namespace deform
