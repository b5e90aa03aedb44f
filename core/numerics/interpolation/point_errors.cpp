// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/interpolation/point_errors.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "core/base/parallel.h"
#include "core/numerics/fast_sums/checked_sums.h"
#include "core/numerics/fast_sums/fast_sums.h"
#include "core/numerics/interpolation/least_squares_interpolator.h"
#include "core/numerics/sampling/point_tree.h"
#include "core/numerics/sampling/stratified.h"

namespace deform {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

constexpr std::size_t most_candidates = 8192;  // largest number of points to choose from
constexpr double many_roundings = 1e3;         // below, a residual in double precision has few digits
constexpr double iterative_share = 1e-3;       // of the residual: to which its interpolant is solved for
constexpr double most_left = 0.9;              // of the residual, that such a solution may leave
// Pairs of centres up to which residuals are summed directly, some seconds, and with twice the digits if they need them. The
// error of sums that are not direct, as a share of the residual, with which it is amplified.
constexpr double most_direct_pairs = 2e9, most_accurate_pairs = 1e9, residual_share = 1e-3;
// Pairs of points and centres up to which errors are summed directly, a tenth of a second; beyond that the points of one fast
// sum, their order to begin with, and their error as a share of the largest error at the places.
constexpr double most_direct_errors = 1e8;
constexpr std::size_t points_together = std::size_t{1} << 18;
constexpr int errors_order = 6;
constexpr double errors_share = 0.05;
constexpr double on_plane = 1e-12;  // unit coordinates that belong to a plane of reflection

/// Numbers 0 .. count - 1 in a low-discrepancy order (multiples of the golden ratio), so that every prefix is spread over them.
std::vector<std::uint32_t> spread_order(std::size_t count) {
  std::vector<std::uint32_t> order;
  std::vector<bool> taken(count);
  constexpr double golden = 0.6180339887498949;
  for (std::size_t i = 0; i < count; ++i) {
    const double x = golden * static_cast<double>(i + 1);
    auto at = std::min(count - 1, static_cast<std::size_t>((x - std::floor(x)) * static_cast<double>(count)));
    while (taken[at]) at = (at + 1) % count;
    taken[at] = true;
    order.push_back(static_cast<std::uint32_t>(at));
  }
  return order;
}

std::size_t images_of(const Parity& parity) { return Images(parity).count; }

}  // namespace

std::vector<std::uint32_t> check_points(std::span<const Vec3> points, std::span<const Vec3> centres, std::size_t most) {
  std::vector<std::uint32_t> candidates;
  for (const std::size_t i : stratified_numbers(points.size(), most_candidates))
    candidates.push_back(static_cast<std::uint32_t>(i));
  const std::size_t count = candidates.size();
  if (count <= most || centres.empty()) {
    candidates.resize(std::min(count, most));
    return candidates;
  }
  const PointTree tree(centres);
  std::vector<double> distance(count);
  parallel_for({}, count, 256, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) distance[i] = tree.nearest(points[candidates[i]]).square;
  });
  std::vector<std::uint32_t> by_distance(count);
  std::iota(by_distance.begin(), by_distance.end(), 0u);
  std::sort(by_distance.begin(), by_distance.end(),
            [&](std::uint32_t a, std::uint32_t b) { return distance[a] != distance[b] ? distance[a] < distance[b] : a < b; });
  std::vector<bool> chosen(count);
  std::size_t taken = 0;
  const auto take = [&](std::size_t rank) {
    if (chosen[by_distance[rank]]) return;
    chosen[by_distance[rank]] = true;
    ++taken;
  };
  // The farthest ones, some of the farthest and of the nearest tenth, and of all.
  for (std::size_t i = 0; i < most / 8; ++i) take(count - 1 - i);
  const std::size_t tenth = std::max<std::size_t>(1, count / 10);
  const std::vector<std::uint32_t> spread = spread_order(tenth);
  for (std::size_t i = 0; i < std::min(tenth, most / 4); ++i) {
    take(count - 1 - spread[i]);
    take(spread[i]);
  }
  for (const std::uint32_t rank : spread_order(count)) {
    if (taken == most) break;
    take(rank);
  }
  std::vector<std::uint32_t> result;
  for (std::size_t i = 0; i < count; ++i) {
    if (chosen[i]) result.push_back(candidates[i]);
  }
  return result;
}

double largest_magnitude(const MatrixXd& errors) {
  if (!errors.allFinite()) return std::numeric_limits<double>::infinity();
  return errors.size() > 0 ? errors.cwiseAbs().maxCoeff() : 0.0;
}

namespace {

/// P^T w over all images, which side conditions want to be 0: least squares leave something in them.
MatrixXd moments(const Interpolator& system, const Interpolants& interpolants, const PolynomialSpace& polynomials,
                 const Parity& images) {
  using Extended = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;
  const auto weights = interpolants.coefficients.rows() - static_cast<Index>(system.polynomials().terms());
  std::vector<Vec3> centres = system.centres();
  if (system.solver() == Solver::incremental_qr) {
    const auto& order = static_cast<const LeastSquaresInterpolator&>(system).order();
    centres.clear();
    for (Index j = 0; j < weights; ++j) centres.push_back(system.centres()[order[static_cast<std::size_t>(j)]]);
  }
  Extended W = interpolants.coefficients.topRows(weights).cast<long double>();
  if (interpolants.rest.size() > 0) W += interpolants.rest.topRows(weights).cast<long double>();
  const Images all(images);
  Extended sum = Extended::Zero(static_cast<Index>(polynomials.terms()), W.cols());
  for (std::size_t g = 0; g < all.count; ++g) {
    std::vector<Vec3> places;
    for (const Vec3& c : centres) places.push_back(all.at[g].of(c));
    sum += static_cast<long double>(all.at[g].sign) * (polynomials.matrix(places).cast<long double>().transpose() * W);
  }
  return sum.cast<double>();
}

}  // namespace

PointErrors::PointErrors(const Interpolator& system, int polynomial_degree, std::vector<Vec3> places, const RunContext& context,
                         std::size_t dense)
    : places_(std::move(places)) {
  InterpolationOptions options;
  options.kernel = system.kernel();
  options.polynomial_degree = polynomial_degree;
  if (system.size() <= dense) {
    dense_ = std::make_unique<const DenseInterpolator>(system.centres(), options, context);
    exact_ = dense_.get();
    return;
  }
  if (system.solver() == Solver::iterative) {
    iterative_ = static_cast<const IterativeInterpolator*>(&system);
  } else {
    std::vector<Vec3> centres = system.centres();
    const Images images(system.kernel().parity);
    if (images.count > 1) {
      centres.clear();
      for (std::uint32_t j = 0; j < system.size(); ++j) {
        const Vec3& c = system.centres()[j];
        for (std::size_t g = 0; g < images.count; ++g) {
          bool again = false;
          for (std::size_t k = 0; k < 3; ++k) again = again || (images.at[g].flip[k] < 0 && std::abs(c[k]) <= on_plane);
          if (again) continue;
          centres.push_back(images.at[g].of(c));
          rows_.push_back({j, images.at[g].sign});
        }
      }
    }
    options.kernel.parity = {};
    own_ =
        std::make_unique<const IterativeInterpolator>(std::move(centres), options, context, IterativeInterpolator::Kernels::any);
    iterative_ = own_.get();
  }
  exact_ = iterative_;
}

MatrixXd PointErrors::residual(const Interpolator& system, const Interpolants& interpolants, const MatrixXd& F, double& error,
                               const RunContext& context) const {
  const std::vector<Vec3>& centres = system.centres();
  const double weights = static_cast<double>(interpolants.coefficients.rows());
  const double pairs = static_cast<double>(centres.size()) * weights;
  error = 0;
  std::vector<double> values;
  if (pairs <= most_direct_pairs || system.solver() != Solver::iterative) {
    values = system.direct_values(interpolants, centres, context);
  } else {
    Interpolants summed;
    summed.coefficients = interpolants.coefficients;
    summed.order = interpolants.order;
    summed.tolerance = 2 * residual_share * interpolants.residual;
    values = system.values(summed, centres, error, context);
  }
  MatrixXd residual = F - Eigen::Map<const RowMajor>(values.data(), F.rows(), F.cols());
  const double rounding =
      system.rounding(interpolants, std::span(centres).first(std::min<std::size_t>(centres.size(), 16)), context);
  if (pairs > most_accurate_pairs || largest_magnitude(residual) > many_roundings * rounding) return residual;
  return system.accurate_residual(interpolants, centres, F, context);
}

PointErrors::Missing PointErrors::missing(const Interpolator& system, const Interpolants& interpolants, const MatrixXd& F,
                                          const RunContext& context) const {
  double error = 0;
  MatrixXd left = residual(system, interpolants, F, error, context);
  const double largest = largest_magnitude(left);
  if (!rows_.empty()) {
    MatrixXd images(static_cast<Index>(rows_.size()), left.cols());
    for (Index r = 0; r < images.rows(); ++r) {
      const Row& row = rows_[static_cast<std::size_t>(r)];
      images.row(r) = row.sign * left.row(static_cast<Index>(row.centre));
    }
    left = std::move(images);
  }
  const auto q = static_cast<Index>(exact_->polynomials().terms());
  MatrixXd B(left.rows() + q, left.cols());
  B << left, -moments(system, interpolants, exact_->polynomials(), rows_.empty() ? Parity{} : system.kernel().parity);
  if (dense_) {
    Interpolants solved = dense_->solve_saddle(B, context);
    return {std::move(solved.coefficients), largest, solved.converged};
  }
  Interpolants solved = iterative_->solve_saddle(B, iterative_share * largest, context);
  // As much as it leaves is missing from it, and what sums that are not direct may have lost.
  const double share = largest > 0 ? (solved.residual + error) / largest : 0;
  if (share > iterative_share) solved.coefficients /= 1 - std::min(share, most_left);
  return {std::move(solved.coefficients), largest};
}

MatrixXd PointErrors::errors(const Missing& missing, std::span<const Vec3> places, const RunContext& context) const {
  Interpolants interpolants;
  interpolants.coefficients = missing.coefficients;
  const std::vector<double> values = exact_->direct_values(interpolants, places, context);
  return Eigen::Map<const RowMajor>(values.data(), static_cast<Index>(places.size()), missing.coefficients.cols());
}

Eigen::VectorXd PointErrors::largest(const Missing& missing, const MatrixXd& errors, std::span<const Vec3> points,
                                     const RunContext& context) const {
  const Index columns = missing.coefficients.cols();
  Eigen::VectorXd result(columns);
  for (Index c = 0; c < columns; ++c) result[c] = largest_magnitude(errors.col(c));
  const RadialKernel& kernel = exact_->kernel();
  const double pairs = static_cast<double>(points.size()) * static_cast<double>(exact_->size());
  const bool fast = pairs > most_direct_errors && properties(kernel.kernel).smooth && kernel.parity.none();
  // In units of the known ones, so that the error of the sums is a share of each.
  const Eigen::VectorXd units = result.unaryExpr([](double size) { return size > 0 && std::isfinite(size) ? size : 1.0; });
  Missing scaled;
  scaled.coefficients = missing.coefficients * units.cwiseInverse().asDiagonal();
  const auto terms = static_cast<Index>(exact_->polynomials().terms());
  const RowMajor rows = scaled.coefficients;
  const std::span<const double> all(rows.data(), static_cast<std::size_t>(rows.size()));
  const auto polynomials = static_cast<std::size_t>(terms * columns);
  for (std::size_t first = 0; first < points.size(); first += points_together) {
    const auto some = points.subspan(first, std::min(points_together, points.size() - first));
    MatrixXd there;
    double error = 0;
    if (fast) {
      CheckedSums sums = checked_sums(kernel, some, exact_->centres(), all.first(all.size() - polynomials),
                                      static_cast<std::size_t>(columns), {errors_order, errors_share, 0}, context);
      add_polynomials(exact_->polynomials(), some, all.last(polynomials), sums.sums, context);
      there = Eigen::Map<const RowMajor>(sums.sums.data(), static_cast<Index>(some.size()), columns);
      error = sums.error;
    } else {
      there = this->errors(scaled, some, context);
    }
    for (Index c = 0; c < columns; ++c) {
      // Not max(), so that NaN counts.
      const double size = units[c] * (largest_magnitude(there.col(c)) + error);
      if (!(size <= result[c])) result[c] = size;
    }
  }
  return result;
}

std::size_t PointErrors::bytes() const {
  const std::size_t own = dense_ ? dense_->bytes() : own_ ? own_->bytes() : 0;
  return own + places_.size() * sizeof(Vec3) + rows_.size() * sizeof(Row);
}

std::size_t PointErrors::bytes_for(std::size_t m, const RadialKernel& kernel, Solver solver) {
  const std::size_t fixed = 1024 * sizeof(Vec3);
  if (m <= most_dense) return DenseInterpolator::bytes_for(m, Solver::ldlt) + m * sizeof(Vec3) + fixed;
  if (solver == Solver::iterative) return fixed;
  const std::size_t rows = m * images_of(kernel.parity);
  return IterativeInterpolator::bytes_for(rows) + rows * (sizeof(Vec3) + sizeof(Row)) + fixed;
}

std::size_t PointErrors::peak_bytes(std::size_t m, const RadialKernel& kernel, Solver solver) {
  constexpr std::size_t fields = 4;
  if (m <= most_dense) return DenseInterpolator::peak_bytes(m, Solver::ldlt) + m * (4 * sizeof(Vec3) + 16);
  if (solver == Solver::iterative) return bytes_for(m, kernel, solver);  // beside what its system takes
  const std::size_t rows = m * images_of(kernel.parity);
  return IterativeInterpolator::peak_bytes(rows, fields) + rows * (sizeof(Vec3) + sizeof(Row));
}

std::size_t PointErrors::largest_bytes(std::size_t n, std::size_t m, const RadialKernel& kernel) {
  constexpr std::size_t fields = 4;
  constexpr int order = 10;  // digits enough for a share of the error
  const std::size_t together = std::min(n, points_together), rows = m * images_of(kernel.parity);
  const bool fast = static_cast<double>(n) * static_cast<double>(rows) > most_direct_errors;
  return (fast ? FastSums::bytes_for(together, rows, order) : 0) + 2 * (together + rows) * fields * sizeof(double);
}

}  // namespace deform
