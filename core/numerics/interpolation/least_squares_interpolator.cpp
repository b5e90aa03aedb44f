// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/interpolation/least_squares_interpolator.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/parallel.h"
#include "core/numerics/kernels/tiles.h"
#include "core/numerics/sampling/farthest_points.h"

namespace deform {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

constexpr std::size_t least_block = 64, block = 256;  // columns appended at a time: the more there are, a quarter of them
constexpr std::size_t greedy_block = 8;  // looking after every column saves a tenth of them and takes ten times as long
constexpr double greedy_share = 0.5;     // of the largest residual: below it, better look again after the next columns
constexpr std::size_t most_basis_terms = PolynomialSpace::most_terms;

[[noreturn]] void refuse(const std::string& what) { throw Error(ErrorCode::invalid_argument, what); }

std::vector<Vec3> checked(std::vector<Vec3> points) {
  if (points.empty()) refuse("points: there are none");
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!std::isfinite(points[i][0] + points[i][1] + points[i][2])) {
      refuse(std::string("points[") + std::to_string(i) + "]: must be finite");
    }
  }
  return points;
}

int checked_degree(const InterpolationOptions& options) {
  const KernelProperties kernel = properties(options.kernel.kernel);
  if (options.polynomial_degree < kernel.order - 1 || options.polynomial_degree > 2) {
    refuse("polynomial_degree: " + std::to_string(options.polynomial_degree) + " is out of range " +
           std::to_string(kernel.order - 1) + "..2 of the kernel " + kernel.name);
  }
  return options.polynomial_degree;
}

void check_values(const MatrixXd& F, std::size_t rows, const char* name) {
  if (F.rows() != static_cast<Index>(rows) || F.cols() == 0) {
    refuse(std::string(name) + ": expected " + std::to_string(rows) + " rows, one per point, and at least one column, got " +
           std::to_string(F.rows()) + " x " + std::to_string(F.cols()));
  }
  for (Index c = 0; c < F.cols(); ++c) {
    for (Index r = 0; r < F.rows(); ++r) {
      if (!std::isfinite(F(r, c))) refuse(std::string(name) + "[" + std::to_string(r) + "]: must be finite");
    }
  }
}

void check_tolerance(double tolerance, const char* name) {
  if (!(tolerance >= 0)) refuse(std::string(name) + ": " + number_digits(tolerance) + " is out of range, must be at least 0");
}

/// Sums of squares of the rows from i to the end, for every i and one past the end: the residual after solving the rows above.
std::vector<double> tails(const MatrixXd& Y, Index first_column, Index columns) {
  std::vector<double> sums(static_cast<std::size_t>(Y.rows()) + 1, 0.0);
  for (Index i = Y.rows(); i > 0; --i) {
    sums[static_cast<std::size_t>(i - 1)] =
        sums[static_cast<std::size_t>(i)] + Y.row(i - 1).segment(first_column, columns).squaredNorm();
  }
  return sums;
}

}  // namespace

LeastSquaresInterpolator::LeastSquaresInterpolator(std::vector<Vec3> centres, const InterpolationOptions& options,
                                                   const RunContext& context)
    : Interpolator(checked(std::move(centres)), options.kernel, checked_degree(options)), qr_(size() + polynomials_.terms()) {
  if (options.samples.size() > 0 || options.order == CentreOrder::greedy) check_values(options.samples, size(), "samples");
  check_tolerance(options.sample_tolerance, "sample_tolerance");
  if (options.columns_per_field == 0) refuse("columns_per_field: must be at least 1");
  const std::size_t most = allowed(options);
  context.progress("factor", 0);
  append_polynomials(context);
  if (options.order == CentreOrder::greedy) {
    prepare_greedily(options, most, context);
  } else {
    prepare_farthest(options, most, context);
  }
  context.progress("factor", 1);
}

std::size_t LeastSquaresInterpolator::bytes_for(std::size_t m, std::size_t k) {
  return BlockedQr::bytes_for(m + most_basis_terms, k + most_basis_terms, block) + 4 * m * sizeof(Vec3);
}

std::size_t LeastSquaresInterpolator::bytes() const {
  return qr_.bytes() + (centres_.size() + chosen_.size()) * sizeof(Vec3) + order_.size() * sizeof(std::uint32_t);
}

std::size_t LeastSquaresInterpolator::allowed(const InterpolationOptions& options) const {
  std::size_t most = std::min(options.most_centres, size());
  if (options.memory_limit == 0 || bytes_for(size(), most) <= options.memory_limit) return most;
  if (bytes_for(size(), 1) > options.memory_limit) {
    throw Error(ErrorCode::out_of_budget, "incremental QR of " + std::to_string(size()) + " points needs " +
                                              std::to_string(bytes_for(size(), 1)) + " bytes for one centre, available are " +
                                              std::to_string(options.memory_limit));
  }
  std::size_t fits = 1;  // most does not
  while (most - fits > 1) {
    const std::size_t middle = fits + (most - fits) / 2;
    (bytes_for(size(), middle) <= options.memory_limit ? fits : most) = middle;
  }
  return fits;
}

void LeastSquaresInterpolator::append_polynomials(const RunContext& context) {
  const MatrixXd P = polynomials_.matrix(centres_);
  const std::size_t taken = qr_.append(
      polynomials_.terms(),
      [&](double* out) {
        for (Index c = 0; c < P.cols(); ++c, out += qr_.rows()) {
          std::copy_n(P.col(c).data(), P.rows(), out);
          std::fill_n(out + P.rows(), P.cols(), 0.0);
        }
      },
      context);
  if (taken < polynomials_.terms()) throw Error(ErrorCode::internal, "incremental QR: the polynomials depend on each other");
}

/// Appends the columns of these points as centres; how many of them were independent.
std::size_t LeastSquaresInterpolator::append(std::span<const std::uint32_t> indices, const RunContext& context) {
  std::vector<Vec3> centres;
  for (const std::uint32_t i : indices) centres.push_back(centres_[i]);
  const std::size_t m = size(), rows = qr_.rows();
  const std::size_t taken = qr_.append(
      indices.size(),
      [&](double* out) {
        const TiledPoints tiled(centres_);
        parallel_for(context, tiled.tiles(), 64, [&](std::size_t begin, std::size_t end) {
          std::vector<double> values(centres.size() * tile_size);
          for (std::size_t t = begin; t < end; ++t) {
            tile_kernel(kernel_, tiled.tile(t), centres, values.data());
            const std::size_t first = t * tile_size, count = std::min(tile_size, m - first);
            for (std::size_t j = 0; j < centres.size(); ++j) {
              std::copy_n(values.data() + j * tile_size, count, out + j * rows + first);
            }
          }
        });
        for (std::size_t j = 0; j < centres.size(); ++j) polynomials_.values(centres[j], out + j * rows + m);
      },
      context);
  order_.insert(order_.end(), indices.begin(), indices.begin() + static_cast<std::ptrdiff_t>(taken));
  chosen_.insert(chosen_.end(), centres.begin(), centres.begin() + static_cast<std::ptrdiff_t>(taken));
  return taken;
}

void LeastSquaresInterpolator::keep(std::size_t centres) {
  order_.resize(std::min(order_.size(), centres));
  chosen_.resize(order_.size());
}

/// Whether all fields are within the tolerance with the columns that Y went through, and the first number of centres for that.
bool LeastSquaresInterpolator::met(const MatrixXd& projected, const InterpolationOptions& options, std::size_t& centres) const {
  const std::size_t q = polynomials_.terms();
  const double limit = options.sample_tolerance * options.sample_tolerance * static_cast<double>(size());
  const auto field = static_cast<Index>(options.columns_per_field);
  std::size_t needed = 0;
  for (Index c = 0; c < projected.cols(); c += field) {
    const std::vector<double> left = tails(projected, c, std::min(field, projected.cols() - c));
    std::size_t k = 0;
    while (k <= chosen_.size() && left[q + k] > limit) ++k;
    needed = std::max(needed, k);
  }
  centres = std::min(needed, chosen_.size());
  return needed <= chosen_.size();
}

void LeastSquaresInterpolator::prepare_farthest(const InterpolationOptions& options, std::size_t most,
                                                const RunContext& context) {
  const bool ends = options.samples.size() > 0 && options.sample_tolerance > 0;
  MatrixXd Y = ends ? with_side_conditions(options.samples) : MatrixXd();
  for (std::size_t p = 0; ends && p < qr_.panels(); ++p) qr_.apply_transposed(p, Y);
  PointCover cover(centres_);
  std::vector<std::uint32_t> next;
  std::size_t needed = 0;
  while (!(ends && met(Y, options, needed)) && order_.size() < most) {
    context.check();
    next.clear();
    const std::size_t width = std::min(std::clamp(order_.size() / 4, least_block, block), most - order_.size());
    while (next.size() < width) {
      const std::size_t point = cover.farthest();
      if (cover.distance(point) == 0) break;  // all the others coincide with earlier ones
      cover.take(point);
      next.push_back(static_cast<std::uint32_t>(point));
    }
    const std::size_t taken = append(next, context);
    if (ends && taken > 0) qr_.apply_transposed(qr_.panels() - 1, Y);
    if (taken < width) break;
    context.progress("factor", static_cast<double>(order_.size()) / static_cast<double>(most));
  }
  if (ends && met(Y, options, needed)) keep(needed);
}

namespace {

/// Where the residual is large and the centres of this batch do not already help: the influence of a new centre reaches about as
/// far as its distance to the centres there were.
std::vector<std::uint32_t> worst_points(const std::vector<double>& residuals, std::span<const Vec3> points, std::size_t most,
                                        PointCover& cover) {
  // Least squares leave something at centres too.
  double largest = 0;
  for (std::size_t i = 0; i < residuals.size(); ++i) {
    if (cover.distance(i) > 0) largest = std::max(largest, residuals[i]);
  }
  std::vector<std::uint32_t> candidates, chosen;
  for (std::size_t i = 0; i < residuals.size(); ++i) {
    if (residuals[i] > 0 && residuals[i] >= greedy_share * largest && cover.distance(i) > 0) {
      candidates.push_back(static_cast<std::uint32_t>(i));
    }
  }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [&](std::uint32_t a, std::uint32_t b) { return residuals[a] > residuals[b]; });
  std::vector<double> reach;
  for (const std::uint32_t candidate : candidates) {
    if (chosen.size() == most) break;
    const Vec3& x = points[candidate];
    bool helped = false;
    for (std::size_t j = 0; j < chosen.size() && !helped; ++j) {
      const Vec3& c = points[chosen[j]];
      helped = std::hypot(x[0] - c[0], x[1] - c[1], x[2] - c[2]) < reach[j];
    }
    if (helped || cover.distance(candidate) == 0) continue;
    reach.push_back(cover.distance(candidate));
    chosen.push_back(candidate);
    cover.take(candidate);
  }
  return chosen;
}

}  // namespace

void LeastSquaresInterpolator::prepare_greedily(const InterpolationOptions& options, std::size_t most,
                                                const RunContext& context) {
  MatrixXd Y = with_side_conditions(options.samples);
  for (std::size_t p = 0; p < qr_.panels(); ++p) qr_.apply_transposed(p, Y);
  PointCover cover(centres_);
  std::size_t needed = 0;
  while (!met(Y, options, needed) && order_.size() < most) {
    context.check();
    const MatrixXd left = residual(Y, order_.size(), qr_.panels());
    std::vector<double> residuals(size());
    for (std::size_t i = 0; i < size(); ++i) residuals[i] = left.row(static_cast<Index>(i)).norm();
    const auto next = worst_points(residuals, centres_, std::min(greedy_block, most - order_.size()), cover);
    if (next.empty()) break;
    const std::size_t taken = append(next, context);
    if (taken > 0) qr_.apply_transposed(qr_.panels() - 1, Y);
    if (taken < next.size()) break;
    context.progress("factor", static_cast<double>(order_.size()) / static_cast<double>(most));
  }
  if (met(Y, options, needed)) keep(needed);
}

/// The residual of the least-squares problem with this number of centres, from the values after the reflectors of this number
/// of panels.
MatrixXd LeastSquaresInterpolator::residual(MatrixXd projected, std::size_t centres, std::size_t panels) const {
  projected.topRows(static_cast<Index>(polynomials_.terms() + centres)).setZero();
  qr_.apply(panels, projected);
  return projected;
}

Interpolants LeastSquaresInterpolator::interpolate(const MatrixXd& F, double tolerance, const RunContext& /*context*/) const {
  check_values(F, size(), "values");
  check_tolerance(tolerance, "tolerance");
  const std::size_t q = polynomials_.terms();
  const double limit = tolerance * tolerance * static_cast<double>(size());
  MatrixXd Y = with_side_conditions(F);
  std::vector<double> left = tails(Y, 0, Y.cols());
  // A row is final once the panel of its column is through: no more panels than needed.
  std::size_t panels = 0, k = 0, last = 0;
  const auto done = [&] {
    while (q + k < last && left[q + k] > limit) ++k;
    return q + k <= last && left[q + k] <= limit;
  };
  bool converged = done();
  while (!converged && panels < qr_.panels()) {
    qr_.apply_transposed(panels, Y);
    left = tails(Y, 0, Y.cols());
    last = std::min(qr_.first(panels) + qr_.width(panels), q + weighted());
    ++panels;
    converged = done();
  }
  Interpolants solution;
  solution.converged = converged;
  solution.rms = std::sqrt(left[q + k] / static_cast<double>(size()));
  MatrixXd X = Y.topRows(static_cast<Index>(q + k));
  qr_.solve(q + k, X);
  solution.coefficients.resize(X.rows(), X.cols());
  solution.coefficients << X.bottomRows(static_cast<Index>(k)), X.topRows(static_cast<Index>(q));
  const MatrixXd errors = residual(std::move(Y), k, panels);
  for (Index i = 0; i < F.rows(); ++i) solution.residual = std::max(solution.residual, errors.row(i).norm());
  solution.residuals = errors.topRows(F.rows()).cwiseAbs().colwise().maxCoeff();
  return solution;
}

std::vector<double> LeastSquaresInterpolator::errors(const MatrixXd& F) const {
  check_values(F, size(), "values");
  MatrixXd Y = with_side_conditions(F);
  for (std::size_t p = 0; p < qr_.panels(); ++p) qr_.apply_transposed(p, Y);
  const std::vector<double> left = tails(Y, 0, Y.cols());
  std::vector<double> result;
  for (std::size_t k = 0; k <= weighted(); ++k) {
    result.push_back(std::sqrt(left[polynomials_.terms() + k] / static_cast<double>(size())));
  }
  return result;
}

MatrixXd LeastSquaresInterpolator::adjoint(MatrixXd B, const RunContext& /*context*/) const {
  const auto m = static_cast<Index>(size()), k = static_cast<Index>(weighted()), q = B.rows() - m;
  MatrixXd X(q + k, B.cols());
  X.topRows(q) = B.bottomRows(q);
  for (Index j = 0; j < k; ++j) X.row(q + j) = B.row(order_[static_cast<std::size_t>(j)]);
  qr_.solve_transposed(static_cast<std::size_t>(q + k), X);
  MatrixXd Y = MatrixXd::Zero(static_cast<Index>(qr_.rows()), B.cols());
  Y.topRows(q + k) = X;
  qr_.apply(qr_.panels(), Y);
  return Y.topRows(m);
}

}  // namespace deform
