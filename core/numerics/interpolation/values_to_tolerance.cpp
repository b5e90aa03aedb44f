// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/interpolation/values_to_tolerance.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace deform {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// Shares of the tolerance: for the coefficients, and for the sums, where values() allows half of Interpolants::tolerance.
constexpr double coefficients_share = 0.5, sums_share = 0.25;
constexpr double first_residual = 0.3;  // of the tolerance: residuals grow more often than not
constexpr double aim = 0.5;             // of what is allowed
constexpr int most_rounds = 4;
// The share of what rounding makes of sums, for that of the weights, which differs from point to point, and of the coordinates,
// which remains where the weights have rests.
constexpr double rounding_share = 0.5;
// Pairs of points and centres that are summed with twice the digits where rounding alone would miss the tolerance: seconds.
constexpr double most_accurate = 1e9;

/// One more round: by the exact correction if it is known, else by the solver with a tolerance below its residual.
bool improve(const Interpolator& system, const PointErrors& check, const MatrixXd& F, const PointErrors::Missing& missing,
             double smaller, Interpolants& interpolants, const RunContext& context) {
  if (check.complete()) {
    add_accurately(missing.coefficients, interpolants);
    return true;
  }
  const double before = interpolants.residual;
  interpolants = system.refine(std::move(interpolants), F, smaller * before, context);
  return interpolants.residual < before;
}

/// Interpolants with what is missing from them: its values at the checked points, and the largest ones of each column over all.
struct Refined {
  Interpolants interpolants;
  MatrixXd errors;
  Eigen::VectorXd largest;
  bool known = true;  ///< whether the errors are
};

/// Until the estimate is allowed or there are no more digits.
Refined refined(const Interpolator& system, const PointErrors& check, const MatrixXd& F, double tolerance,
                std::span<const Vec3> points, const RunContext& context) {
  const double allowed = coefficients_share * tolerance;
  Interpolants interpolants = system.interpolate(F, first_residual * tolerance, context);
  Refined best;
  double least = std::numeric_limits<double>::infinity();
  for (int round = 0;; ++round) {
    const PointErrors::Missing missing = check.missing(system, interpolants, F, context);
    MatrixXd errors = check.errors(missing, context);
    Eigen::VectorXd largest = check.largest(missing, errors, points, context);
    const double error = error_margin * largest_magnitude(largest);
    if (round > 0 && !(error < least)) break;
    const bool slow = error > 0.5 * least;
    best = {interpolants, std::move(errors), std::move(largest), missing.known};
    if (check.complete()) best.interpolants.residual = missing.residual;
    least = error;
    if (error <= allowed || slow || round == most_rounds) break;
    const double smaller = std::clamp(aim * allowed / error, 1e-4, aim);
    if (!improve(system, check, F, missing, smaller, interpolants, context)) break;
  }
  best.interpolants.tolerance = 2 * sums_share * tolerance;
  return best;
}

}  // namespace

CheckedValues values_to_tolerance(const Interpolator& system, const PointErrors& check, std::span<const std::uint32_t> checked,
                                  const MatrixXd& F, double tolerance, std::span<const Vec3> points, const RunContext& context) {
  CheckedValues result;
  const bool iterative = system.solver() == Solver::iterative;
  Refined solved;
  if (iterative) {
    solved = refined(system, check, F, tolerance, points, context);
  } else {
    solved.interpolants = system.interpolate(F, tolerance, context);
    const PointErrors::Missing missing = check.missing(system, solved.interpolants, F, context);
    solved.errors = check.errors(missing, context);
    solved.largest = check.largest(missing, solved.errors, points, context).cwiseMax(solved.interpolants.residuals);
    solved.known = missing.known;
  }
  result.errors = std::move(solved.errors);
  // Other points may be off by more than the checked ones.
  Eigen::VectorXd elsewhere(F.cols());
  for (Index c = 0; c < F.cols(); ++c) {
    elsewhere[c] = error_margin * std::max(0.0, solved.largest[c] - largest_magnitude(result.errors.col(c)));
  }
  if (!solved.known) elsewhere.setConstant(std::numeric_limits<double>::infinity());
  double sums_error = 0;
  const double rounding = system.rounding(solved.interpolants, check.places(), context);
  const double pairs = static_cast<double>(points.size()) * static_cast<double>(system.size());
  const bool accurate = iterative && 8 * rounding > sums_share * tolerance && pairs <= most_accurate;
  result.from = {std::move(solved.interpolants), accurate ? SolvedValues::Sums::accurate : SolvedValues::Sums::usual};
  const Interpolants& solution = result.from.interpolants;
  result.values = values_elsewhere(system, result.from, points, sums_error, context);
  MatrixXd delivered(static_cast<Index>(checked.size()), F.cols());
  for (Index s = 0; s < delivered.rows(); ++s) {
    for (Index c = 0; c < F.cols(); ++c) {
      delivered(s, c) =
          result.values[checked[static_cast<std::size_t>(s)] * static_cast<std::size_t>(F.cols()) + static_cast<std::size_t>(c)];
    }
  }
  // (exact - interpolant) + (interpolant - delivered).
  result.errors -= system.accurate_residual(solution, check.places(), delivered, context);
  result.more = elsewhere.array() + (sums_error + rounding_share * rounding);
  result.error = error_margin * largest_magnitude(result.errors) + largest_magnitude(result.more);
  result.residual = solution.residual;
  result.converged = iterative ? result.error <= tolerance : solution.converged;
  return result;
}

std::vector<double> values_elsewhere(const Interpolator& system, const SolvedValues& solved, std::span<const Vec3> points,
                                     double& sums_error, const RunContext& context) {
  if (solved.sums == SolvedValues::Sums::usual) return system.values(solved.interpolants, points, sums_error, context);
  sums_error = 0;
  const Index columns = solved.interpolants.coefficients.cols();
  const RowMajor negative =
      system.accurate_residual(solved.interpolants, points, MatrixXd::Zero(static_cast<Index>(points.size()), columns), context);
  std::vector<double> values(negative.data(), negative.data() + negative.size());
  for (double& value : values) value = -value;
  return values;
}

}  // namespace deform
