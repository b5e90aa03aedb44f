// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/interpolation/point_errors.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "core/base/parallel.h"
#include "core/numerics/interpolation/least_squares_interpolator.h"
#include "core/numerics/sampling/farthest_points.h"
#include "core/numerics/sampling/point_tree.h"
#include "core/numerics/sampling/stratified.h"

namespace deform {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

constexpr std::size_t most_candidates = 8192;  // largest number of points to choose from
// Numbers of the centres in use: a sample of all; around each place the nearest of all, of a quarter, of a sixteenth, ...
constexpr std::size_t overall = 700, around = 6, thinner = 4;
constexpr std::size_t most_surrounded = 96;  // largest number of places treated this way
constexpr double many_roundings = 1e3;       // below, a residual in double precision has few digits
constexpr double iterative_share = 1e-3;     // of the residual: to which its interpolant is solved for
constexpr double most_left = 0.9;            // of the residual, that such a solution may leave

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

/// The points nearest to x among those of the tree, at least `count` of them.
void nearest(const PointTree& tree, const Vec3& x, std::size_t count, std::vector<PointTree::Near>& out) {
  out.clear();
  const double square = tree.kth_square(x, std::min(count, tree.size()));
  tree.within(x, std::nextafter(square, std::numeric_limits<double>::infinity()), out);
  std::sort(out.begin(), out.end(),
            [](const auto& a, const auto& b) { return a.square != b.square ? a.square < b.square : a.point < b.point; });
  out.resize(std::min(count, out.size()));
}

std::vector<std::uint32_t> participants(std::span<const Vec3> centres, std::span<const Vec3> places, std::size_t most) {
  std::vector<std::uint32_t> ids(centres.size());
  std::iota(ids.begin(), ids.end(), 0u);
  if (centres.size() <= most) return ids;
  std::vector<bool> chosen(centres.size());
  for (const std::uint32_t id : farthest_point_order(centres, overall)) chosen[id] = true;
  const std::vector<std::uint32_t> order = spread_order(centres.size());
  std::vector<PointTree::Near> near;
  for (std::size_t size = centres.size(); size > overall; size /= thinner) {
    std::vector<Vec3> thinned;
    for (std::size_t i = 0; i < size; ++i) thinned.push_back(centres[order[i]]);
    const PointTree tree(thinned);
    for (std::size_t p = 0; p < places.size(); p += places.size() / most_surrounded + 1) {
      nearest(tree, places[p], around, near);
      for (const auto& found : near) chosen[order[found.point]] = true;
    }
  }
  ids.clear();
  for (std::uint32_t id = 0; id < centres.size(); ++id) {
    if (chosen[id]) ids.push_back(id);
  }
  if (ids.size() <= most) return ids;
  std::vector<std::uint32_t> fewer;
  for (const std::uint32_t i : spread_order(ids.size())) {
    if (fewer.size() < most) fewer.push_back(ids[i]);
  }
  std::sort(fewer.begin(), fewer.end());
  return fewer;
}

/// Whether a part of the centres does not represent the residual, so that all of them are used, iteratively.
bool needs_all(const RadialKernel& kernel, Solver solver, std::size_t m, const PointErrors::Limits& limits) {
  const KernelProperties known = properties(kernel.kernel);
  const bool local = solver == Solver::incremental_qr || known.has_shape;
  return m > limits.dense && m <= limits.iterative && local && known.smooth && kernel.parity.none();
}

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

/// P^T w, which side conditions want to be 0: least squares leave something in them.
MatrixXd moments(const Interpolator& system, const Interpolants& interpolants, const PolynomialSpace& polynomials) {
  const auto weights = interpolants.coefficients.rows() - static_cast<Index>(system.polynomials().terms());
  std::vector<Vec3> centres = system.centres();
  if (system.solver() == Solver::incremental_qr) {
    const auto& order = static_cast<const LeastSquaresInterpolator&>(system).order();
    centres.clear();
    for (Index j = 0; j < weights; ++j) centres.push_back(system.centres()[order[static_cast<std::size_t>(j)]]);
  }
  const auto P = polynomials.matrix(centres).cast<long double>().eval();
  Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic> W = interpolants.coefficients.topRows(weights).cast<long double>();
  if (interpolants.rest.size() > 0) W += interpolants.rest.topRows(weights).cast<long double>();
  return (P.transpose() * W).cast<double>();
}

}  // namespace

PointErrors::PointErrors(const Interpolator& system, int polynomial_degree, std::vector<Vec3> places, const RunContext& context,
                         const Limits& limits)
    : places_(std::move(places)), centres_(system.size()) {
  InterpolationOptions options;
  options.kernel = system.kernel();
  options.polynomial_degree = polynomial_degree;
  if (needs_all(system.kernel(), system.solver(), system.size(), limits)) {
    ids_.resize(system.size());
    std::iota(ids_.begin(), ids_.end(), 0u);
    iterative_ = std::make_unique<const IterativeInterpolator>(system.centres(), options, context);
    exact_ = iterative_.get();
    return;
  }
  ids_ = participants(system.centres(), places_, limits.dense);
  std::vector<Vec3> centres;
  for (const std::uint32_t id : ids_) centres.push_back(system.centres()[id]);
  dense_ = std::make_unique<const DenseInterpolator>(std::move(centres), options, context);
  exact_ = dense_.get();
}

MatrixXd PointErrors::residual(const Interpolator& system, const Interpolants& interpolants, const MatrixXd& F,
                               const RunContext& context) const {
  MatrixXd wanted(static_cast<Index>(ids_.size()), F.cols());
  for (Index j = 0; j < wanted.rows(); ++j) wanted.row(j) = F.row(ids_[static_cast<std::size_t>(j)]);
  const std::vector<double> values = system.direct_values(interpolants, exact_->centres(), context);
  const MatrixXd residual = wanted - Eigen::Map<const RowMajor>(values.data(), wanted.rows(), wanted.cols());
  const std::vector<Vec3>& centres = exact_->centres();
  const double rounding =
      system.rounding(interpolants, std::span(centres).first(std::min<std::size_t>(centres.size(), 16)), context);
  if (largest_magnitude(residual) > many_roundings * rounding) return residual;
  return system.accurate_residual(interpolants, centres, wanted, context);
}

PointErrors::Missing PointErrors::missing(const Interpolator& system, const Interpolants& interpolants, const MatrixXd& F,
                                          const RunContext& context) const {
  MatrixXd left = residual(system, interpolants, F, context);
  const double largest = largest_magnitude(left);
  for (Index c = 0; c < F.cols() && partial() && interpolants.residuals.size() == F.cols(); ++c) {
    const double seen = left.col(c).cwiseAbs().maxCoeff();
    if (seen > 0) left.col(c) *= std::max(1.0, interpolants.residuals[c] / seen);
  }
  const auto q = static_cast<Index>(exact_->polynomials().terms());
  MatrixXd B(left.rows() + q, left.cols());
  B << left, -moments(system, interpolants, exact_->polynomials());
  if (dense_) return {dense_->solve_saddle(B, context).coefficients, largest};
  Interpolants solved = iterative_->solve_saddle(B, iterative_share * largest, context);
  // As much as it leaves is missing from it.
  const double share = largest > 0 ? solved.residual / largest : 0;
  if (share > iterative_share) solved.coefficients /= 1 - std::min(share, most_left);
  return {std::move(solved.coefficients), largest};
}

MatrixXd PointErrors::errors(const Missing& missing, std::span<const Vec3> places, const RunContext& context) const {
  Interpolants interpolants;
  interpolants.coefficients = missing.coefficients;
  const std::vector<double> values = exact_->direct_values(interpolants, places, context);
  return Eigen::Map<const RowMajor>(values.data(), static_cast<Index>(places.size()), missing.coefficients.cols());
}

std::size_t PointErrors::bytes() const { return exact_->bytes() + places_.size() * sizeof(Vec3) + ids_.size() * 4; }

std::size_t PointErrors::bytes_for(std::size_t m, const RadialKernel& kernel, Solver solver) {
  const std::size_t fixed = 1024 * sizeof(Vec3);
  if (needs_all(kernel, solver, m, {})) return IterativeInterpolator::bytes_for(m) + m * 4 + fixed;
  const std::size_t k = std::min(m, most_centres);
  return DenseInterpolator::bytes_for(k, Solver::ldlt) + k * (sizeof(Vec3) + 4) + fixed;
}

std::size_t PointErrors::peak_bytes(std::size_t m, const RadialKernel& kernel, Solver solver) {
  constexpr std::size_t fields = 4;
  if (needs_all(kernel, solver, m, {})) return IterativeInterpolator::peak_bytes(m, fields);
  // Beside the matrix two trees of the centres, and a choice of them.
  return DenseInterpolator::peak_bytes(std::min(m, most_centres), Solver::ldlt) + m * (4 * sizeof(Vec3) + 16);
}

}  // namespace deform
