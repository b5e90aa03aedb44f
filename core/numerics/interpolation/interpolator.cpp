// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/interpolation/interpolator.h"

#include <algorithm>

#include "core/numerics/interpolation/dense_interpolator.h"
#include "core/numerics/interpolation/iterative_interpolator.h"
#include "core/numerics/interpolation/least_squares_interpolator.h"
#include "core/numerics/kernels/tiles.h"

namespace deform {

Interpolator::Interpolator(std::vector<Vec3> centres, const RadialKernel& kernel, int polynomial_degree)
    : centres_(std::move(centres)), kernel_(kernel), polynomials_(centres_, polynomial_degree, kernel.parity) {}

std::vector<double> Interpolator::values(const Interpolants& interpolants, std::span<const Vec3> points,
                                         const RunContext& context) const {
  const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rows = interpolants.coefficients;
  const std::span<const double> all(rows.data(), static_cast<std::size_t>(rows.size()));
  const std::size_t polynomials = polynomials_.terms() * static_cast<std::size_t>(rows.cols());
  std::vector<double> result = weighted_sums(interpolants, all.first(all.size() - polynomials), points, context);
  add_polynomials(polynomials_, points, all.last(polynomials), result, context);
  return result;
}

std::vector<double> Interpolator::weighted_sums(const Interpolants& interpolants, std::span<const double> weights,
                                                std::span<const Vec3> points, const RunContext& context) const {
  return kernel_sums(kernel_, points, centres_, weights, static_cast<std::size_t>(interpolants.coefficients.cols()), context);
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
  // Beside the factor the samples, what was made of them, and a request.
  if (solver == Solver::incremental_qr) {
    return interpolator_bytes(m, solver) + 16 * (m + PolynomialSpace::most_terms) * sizeof(double);
  }
  return DenseInterpolator::peak_bytes(m, solver);
}

}  // namespace deform
