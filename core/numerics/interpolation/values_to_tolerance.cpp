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
// Of what rounding makes of sums, for that of the weights, which differs from point to point, and of the coordinates, which
// remains where the weights have rests.
constexpr double rounding_share = 0.5;
// Pairs of points and centres that are summed with twice the digits where rounding alone would miss the tolerance: seconds.
constexpr double most_accurate = 1e9;
constexpr double most_checked = 1e8;  // pairs of points and centres for which all points are checked: a tenth of a second

/// The points nearest to the centres with the largest residuals.
std::vector<Vec3> beside_the_worst(const Interpolator& system, const Interpolants& interpolants, std::span<const Vec3> points) {
  std::vector<Vec3> places;
  for (const std::uint32_t centre : interpolants.worst) {
    const Vec3& c = system.centres()[centre];
    double least = std::numeric_limits<double>::infinity();
    std::size_t nearest = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Vec3 d{points[i][0] - c[0], points[i][1] - c[1], points[i][2] - c[2]};
      const double square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
      if (square < least) {
        least = square;
        nearest = i;
      }
    }
    if (!points.empty()) places.push_back(points[nearest]);
  }
  return places;
}

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

/// Until the estimate is allowed or there are no more digits.
Interpolants refined(const Interpolator& system, const PointErrors& check, const MatrixXd& F, double tolerance,
                     PointErrors::Missing& left, const RunContext& context) {
  const double allowed = coefficients_share * tolerance;
  Interpolants interpolants = system.interpolate(F, first_residual * tolerance, context);
  Interpolants best;
  double least = std::numeric_limits<double>::infinity();
  for (int round = 0;; ++round) {
    const PointErrors::Missing missing = check.missing(system, interpolants, F, context);
    const double error = error_margin * largest_magnitude(check.errors(missing, context));
    if (round > 0 && !(error < least)) break;
    const bool slow = error > 0.5 * least;
    best = interpolants;
    if (check.complete()) best.residual = missing.residual;
    left = missing;
    least = error;
    if (error <= allowed || slow || round == most_rounds) break;
    const double smaller = std::clamp(aim * allowed / error, 1e-4, aim);
    if (!improve(system, check, F, missing, smaller, interpolants, context)) break;
  }
  best.tolerance = 2 * sums_share * tolerance;
  return best;
}

}  // namespace

CheckedValues values_to_tolerance(const Interpolator& system, const PointErrors& check, std::span<const std::uint32_t> checked,
                                  const MatrixXd& F, double tolerance, std::span<const Vec3> points, const RunContext& context) {
  CheckedValues result;
  const bool iterative = system.solver() == Solver::iterative;
  Interpolants interpolants;
  PointErrors::Missing missing;
  if (iterative) {
    interpolants = refined(system, check, F, tolerance, missing, context);
  } else {
    interpolants = system.interpolate(F, tolerance, context);
    missing = check.missing(system, interpolants, F, context);
  }
  result.errors = check.errors(missing, context);
  // Other points may be off by more than the places, most likely where the residual is largest.
  const double pairs = static_cast<double>(points.size()) * static_cast<double>(system.size());
  const std::vector<Vec3> beside = pairs > most_checked ? beside_the_worst(system, interpolants, points) : std::vector<Vec3>{};
  const std::span<const Vec3> others = pairs > most_checked ? std::span<const Vec3>(beside) : points;
  double elsewhere = largest_magnitude(check.errors(missing, others, context)) - largest_magnitude(result.errors);
  if (!iterative) elsewhere = std::max(elsewhere, interpolants.residual - largest_magnitude(result.errors));
  elsewhere = std::max(0.0, error_margin * elsewhere);
  double sums_error = 0;
  const double rounding = system.rounding(interpolants, check.places(), context);
  const bool accurate = iterative && 8 * rounding > sums_share * tolerance && pairs <= most_accurate;
  result.from = {std::move(interpolants), accurate ? SolvedValues::Sums::accurate : SolvedValues::Sums::usual};
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
  result.more = elsewhere + sums_error + rounding_share * rounding;
  result.error = error_margin * largest_magnitude(result.errors) + result.more;
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
