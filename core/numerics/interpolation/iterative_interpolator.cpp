// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/interpolation/iterative_interpolator.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/error.h"
#include "core/numerics/dense/decompositions.h"
#include "core/numerics/fast_sums/checked_sums.h"
#include "core/numerics/kernels/residual.h"
#include "core/numerics/kernels/tiles.h"
#include "core/numerics/sampling/stratified.h"

namespace deform {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

constexpr int first_order = 6, last_sum_order = 16;
constexpr int direct = last_sum_order + 2;          // "order" of direct sums, which are exact
constexpr std::size_t most_direct_centres = 30000;  // a second or two per product
constexpr int most_iterations = 60;                 // between restarts; determines the memory of the basis
constexpr int most_restarts = 6;
constexpr int patience = 8;  // steps that may bring nothing
constexpr std::size_t most_measured_samples = 1024;
constexpr double adjoint_tolerance = 1e-13;  // of the largest value: the residual grows by about the size of the weights
constexpr double adjoint_accuracy = 1e-13;   // of the largest sum
constexpr int adjoint_order = 12;            // of these sums to begin with
constexpr double allowed_share = 0.05;       // of the tolerance, for the sums of one step

const RadialKernel& taken(const RadialKernel& kernel, IterativeInterpolator::Kernels allowed) {
  const KernelProperties known = properties(kernel.kernel);
  if (!known.smooth && allowed == IterativeInterpolator::Kernels::smooth) {
    throw Error(ErrorCode::invalid_argument,
                std::string("method.rbf.solver: ITERATIVE needs a kernel that is smooth away from its centre, ") + known.name +
                    " is not");
  }
  if (!kernel.parity.none()) {
    throw Error(ErrorCode::invalid_argument, "solver: the iterative one has no images; give it all centres and their images");
  }
  return kernel;
}

/// One column's Krylov space.
struct Krylov {
  std::vector<VectorXd> V, Z;
  MatrixXd H = MatrixXd::Zero(most_iterations + 1, most_iterations);
  double beta = 0;
  double left = 0;  ///< norm of the residual
  std::vector<double> history;
  bool active = false;

  /// Coefficients of the least squares solution, and of the residual in V.
  VectorXd solution(VectorXd& rest) const {
    const auto j = static_cast<Index>(Z.size());
    VectorXd e = VectorXd::Zero(j + 1);
    e[0] = beta;
    const VectorXd y = HouseholderQr(H.topLeftCorner(j + 1, j)).solve(e);
    rest = e - H.topLeftCorner(j + 1, j) * y;
    return y;
  }
};

}  // namespace

IterativeInterpolator::IterativeInterpolator(std::vector<Vec3> centres, const InterpolationOptions& options,
                                             const RunContext& context, Kernels allowed)
    : Interpolator(std::move(centres), taken(options.kernel, allowed), options.polynomial_degree),
      preconditioner_(kernel_, centres_, options.polynomial_degree, context) {}

/// One call of solve_saddle().
class IterativeInterpolator::Solve {
 public:
  Solve(const IterativeInterpolator& system, double tolerance, const RunContext& context)
      : system_(system), tolerance_(tolerance), context_(context) {
    samples_ = stratified_numbers(system.centres_.size(), most_measured_samples);
    for (const std::size_t s : samples_) places_.push_back(system.centres_[s]);
    use_order(lowest());
  }

  /// From some interpolants, or none.
  Interpolants run(const MatrixXd& B, const Interpolants* start);

 private:
  void use_order(int order) {
    order_ = order;
    sums_.reset();
    if (order == direct) return;
    sums_ = std::make_unique<FastSums>(system_.kernel_, system_.centres_, system_.centres_, FastSums::Options{order, 0});
  }
  bool has_fast_sums() const { return properties(system_.kernel_.kernel).smooth; }
  int lowest() const { return has_fast_sums() ? first_order : direct; }
  /// The highest order, which is `direct` for few centres.
  int highest() const { return system_.centres_.size() <= most_direct_centres || !has_fast_sums() ? direct : last_sum_order; }
  MatrixXd product(const MatrixXd& weights) const;
  MatrixXd accurate_difference(const MatrixXd& weights, const MatrixXd& values) const;
  VectorXd error_of_sums(const MatrixXd& weights, const MatrixXd& fast) const;
  MatrixXd accurate_product(const MatrixXd& weights, const std::vector<Krylov*>& columns);
  void improve(const MatrixXd& residual, MatrixXd& weights);
  void step(std::vector<Krylov>& columns);
  bool done(Krylov& column) const;
  static bool exhausted(Krylov& column);

  const IterativeInterpolator& system_;
  const double tolerance_;
  const RunContext& context_;
  std::vector<std::size_t> samples_;
  std::vector<Vec3> places_;
  int order_ = 0, iterations_ = 0;
  std::unique_ptr<const FastSums> sums_;
};

MatrixXd IterativeInterpolator::Solve::product(const MatrixXd& weights) const {
  const RowMajor rows = weights;
  const std::span<const double> all(rows.data(), static_cast<std::size_t>(rows.size()));
  const auto columns = static_cast<std::size_t>(rows.cols());
  const std::vector<double> sums = sums_
                                       ? sums_->sums(all, columns, context_)
                                       : kernel_sums(system_.kernel_, system_.centres_, system_.centres_, all, columns, context_);
  return Eigen::Map<const RowMajor>(sums.data(), rows.rows(), rows.cols());
}

MatrixXd IterativeInterpolator::Solve::accurate_difference(const MatrixXd& weights, const MatrixXd& values) const {
  return deform::accurate_residual(system_.kernel_, system_.centres_, system_.centres_, MatrixXd(values.rows(), 0), weights,
                                   values, context_);
}

/// Twice the largest error over the samples, per column: elsewhere it may be larger.
VectorXd IterativeInterpolator::Solve::error_of_sums(const MatrixXd& weights, const MatrixXd& fast) const {
  if (order_ == direct) return VectorXd::Zero(weights.cols());
  const RowMajor rows = weights;
  const auto columns = static_cast<std::size_t>(rows.cols());
  const std::vector<double> exact =
      kernel_sums(system_.kernel_, places_, system_.centres_,
                  std::span<const double>(rows.data(), static_cast<std::size_t>(rows.size())), columns, context_);
  VectorXd largest = VectorXd::Zero(weights.cols());
  for (std::size_t s = 0; s < samples_.size(); ++s) {
    for (Index c = 0; c < weights.cols(); ++c) {
      const double error = exact[s * columns + static_cast<std::size_t>(c)] - fast(static_cast<Index>(samples_[s]), c);
      largest[c] = std::max(largest[c], 2 * std::abs(error));
    }
  }
  return largest;
}

/// A direction enters the solution with about the norm of the residual, so the smaller the residual, the less accurate its
/// product may be (Simoncini, Szyld: Theory of inexact Krylov subspace methods, 2003).
MatrixXd IterativeInterpolator::Solve::accurate_product(const MatrixXd& weights, const std::vector<Krylov*>& columns) {
  while (true) {
    MatrixXd result = product(weights);
    const VectorXd error = error_of_sums(weights, result);
    double share = 0;
    for (std::size_t c = 0; c < columns.size(); ++c) share = std::max(share, error[static_cast<Index>(c)] * columns[c]->left);
    if (share <= allowed_share * tolerance_ || order_ >= highest()) {
      if (share < 1e-4 * allowed_share * tolerance_ && order_ > lowest()) use_order(order_ - 2);
      return result;
    }
    use_order(order_ + 2);
  }
}

bool IterativeInterpolator::Solve::done(Krylov& column) const {
  VectorXd rest;
  column.solution(rest);
  column.left = rest.norm();
  // The largest entry is at least the root mean square, so look closer only when that is small.
  const double rms = column.left / std::sqrt(static_cast<double>(column.V[0].size()));
  if (rms > 0.5 * tolerance_) return false;
  VectorXd residual = VectorXd::Zero(column.V[0].size());
  for (std::size_t i = 0; i < column.V.size(); ++i) residual += rest[static_cast<Index>(i)] * column.V[i];
  return residual.lpNorm<Eigen::Infinity>() <= 0.5 * tolerance_;
}

/// Beyond the precision of the arithmetic more directions add noise only.
bool IterativeInterpolator::Solve::exhausted(Krylov& column) {
  column.history.push_back(column.left);
  const auto steps = static_cast<int>(column.history.size());
  return column.left < 1e-14 * column.beta ||
         (steps > patience && column.left > 0.9 * column.history[static_cast<std::size_t>(steps - 1 - patience)]);
}

void IterativeInterpolator::Solve::step(std::vector<Krylov>& columns) {
  std::vector<Krylov*> active;
  for (Krylov& column : columns) {
    if (column.active) active.push_back(&column);
  }
  MatrixXd from(active[0]->V[0].size(), static_cast<Index>(active.size()));
  for (std::size_t c = 0; c < active.size(); ++c) from.col(static_cast<Index>(c)) = active[c]->V.back();
  const MatrixXd z = system_.preconditioner_.apply(from, context_);
  MatrixXd product = accurate_product(z, active);
  system_.preconditioner_.project(product);
  for (std::size_t c = 0; c < active.size(); ++c) {
    Krylov& column = *active[c];
    const auto j = static_cast<Index>(column.Z.size());
    column.Z.emplace_back(z.col(static_cast<Index>(c)));
    VectorXd u = product.col(static_cast<Index>(c));
    // Twice is enough to stay orthogonal.
    for (int pass = 0; pass < 2; ++pass) {
      for (Index i = 0; i <= j; ++i) {
        const double h = column.V[static_cast<std::size_t>(i)].dot(u);
        column.H(i, j) += h;
        u -= h * column.V[static_cast<std::size_t>(i)];
      }
    }
    const double norm = u.norm();
    column.H(j + 1, j) = norm;
    column.V.emplace_back(norm > 0 ? VectorXd(u / norm) : VectorXd::Zero(u.size()));
    column.active = norm > 1e-15 * column.H.col(j).norm() && j + 1 < most_iterations && !done(column) && !exhausted(column);
  }
  ++iterations_;
}

void IterativeInterpolator::Solve::improve(const MatrixXd& residual, MatrixXd& weights) {
  std::vector<Krylov> columns(static_cast<std::size_t>(residual.cols()));
  bool any = false;
  for (std::size_t c = 0; c < columns.size(); ++c) {
    const auto r = residual.col(static_cast<Index>(c));
    columns[c].beta = columns[c].left = r.norm();
    columns[c].active = r.lpNorm<Eigen::Infinity>() > 0.5 * tolerance_;
    if (!columns[c].active) continue;
    columns[c].V.emplace_back(r / columns[c].beta);
    any = true;
  }
  for (int j = 0; any; ++j) {
    step(columns);
    context_.progress("solve", static_cast<double>(j + 1) / most_iterations);
    any = std::any_of(columns.begin(), columns.end(), [](const Krylov& column) { return column.active; });
  }
  for (std::size_t c = 0; c < columns.size(); ++c) {
    if (columns[c].Z.empty()) continue;
    VectorXd rest;
    const VectorXd y = columns[c].solution(rest);
    for (std::size_t i = 0; i < columns[c].Z.size(); ++i) {
      weights.col(static_cast<Index>(c)) += y[static_cast<Index>(i)] * columns[c].Z[i];
    }
  }
}

Interpolants IterativeInterpolator::Solve::run(const MatrixXd& B, const Interpolants* start) {
  const auto m = static_cast<Index>(system_.centres_.size());
  const MatrixXd P = system_.polynomials_.matrix(system_.centres_);
  const HouseholderQr qr(P);
  const MatrixXd& Q = system_.preconditioner_.polynomials();
  const MatrixXd R = qr.packed().topRows(P.cols()).triangularView<Eigen::Upper>();
  MatrixXd weights = MatrixXd::Zero(m, B.cols());
  const auto g = B.bottomRows(P.cols());
  // The least w with P^T w = g, where P^T P = R^T R; all that is added later is orthogonal to the polynomials.
  if (start != nullptr) {
    weights = start->coefficients.topRows(m);
    use_order(std::clamp(start->order, lowest(), highest()));
  } else if (!g.isZero(0))
    weights = P * symmetric_solution(R.transpose() * R, g);

  Interpolants best, solution;
  best.residual = std::numeric_limits<double>::infinity();
  best.converged = false;
  best.tolerance = solution.tolerance = tolerance_;
  MatrixXd residual;
  int steps = 0;  // of the last round
  for (int restart = 0;; ++restart) {
    const MatrixXd fast = product(weights);
    const VectorXd errors = error_of_sums(weights, fast);
    const double error = errors.maxCoeff();
    // Beyond fast sums it is the rounding of sums that is in the way.
    const MatrixXd whole =
        order_ == direct && has_fast_sums() ? accurate_difference(weights, B.topRows(m)) : MatrixXd(B.topRows(m) - fast);
    residual = whole;
    if (P.cols() > 0) residual -= Q * (Q.transpose() * whole);
    solution.residual = residual.cwiseAbs().maxCoeff() + error;
    solution.residuals = residual.cwiseAbs().colwise().maxCoeff().transpose() + errors;
    solution.converged = solution.residual <= tolerance_;
    solution.coefficients.resize(m + P.cols(), B.cols());
    solution.coefficients.topRows(m) = weights;
    if (P.cols() > 0) solution.coefficients.bottomRows(P.cols()) = qr.solve(whole);
    solution.order = order_;
    solution.iterations = iterations_;
    // A short round that does not halve the residual, because the weights that it adds are large and so are their rounding
    // errors, is often followed by one that does. A long one met the limits of the preconditioner.
    const bool stuck = solution.residual > 0.5 * best.residual && steps > patience;
    if (solution.residual < best.residual) best = solution;
    if (solution.converged || stuck || restart == most_restarts) return best;
    if (error > 0.25 * tolerance_) {
      if (order_ >= highest()) return best;
      use_order(order_ + 2);
      if (error > tolerance_) {
        // Estimate again before any work on wrong sums.
        --restart;
        steps = 0;
        continue;
      }
    }
    const int before = iterations_;
    improve(residual, weights);
    steps = iterations_ - before;
  }
}

Interpolants IterativeInterpolator::solve_saddle(const MatrixXd& B, double tolerance, const RunContext& context) const {
  return Solve(*this, tolerance, context).run(B, nullptr);
}

Interpolants IterativeInterpolator::refine(Interpolants interpolants, const MatrixXd& F, double tolerance,
                                           const RunContext& context) const {
  const int before = interpolants.iterations;
  Interpolants better = Solve(*this, tolerance, context).run(with_side_conditions(F), &interpolants);
  if (!(better.residual < interpolants.residual)) return interpolants;
  better.iterations += before;
  return better;
}

Interpolants IterativeInterpolator::interpolate(const MatrixXd& F, double tolerance, const RunContext& context) const {
  return solve_saddle(with_side_conditions(F), tolerance, context);
}

MatrixXd IterativeInterpolator::adjoint(MatrixXd B, const RunContext& context) const {
  const double tolerance = adjoint_tolerance * B.cwiseAbs().maxCoeff();
  return solve_saddle(B, tolerance, context).coefficients.topRows(static_cast<Index>(size()));  // symmetric
}

std::vector<double> IterativeInterpolator::weighted_sums(const Interpolants& interpolants, std::span<const double> weights,
                                                         std::span<const Vec3> points, double& error,
                                                         const RunContext& context) const {
  if (!properties(kernel_.kernel).smooth) return Interpolator::weighted_sums(interpolants, weights, points, error, context);
  const SumAccuracy accuracy{std::clamp(interpolants.order, first_order, last_sum_order), 0.5 * interpolants.tolerance, 0};
  CheckedSums checked = checked_sums(kernel_, points, centres_, weights,
                                     static_cast<std::size_t>(interpolants.coefficients.cols()), accuracy, context);
  error = checked.error;
  return std::move(checked.sums);
}

std::vector<double> IterativeInterpolator::sums_at_centres(std::span<const Vec3> places, std::span<const double> weights,
                                                           std::size_t columns, const RunContext& context) const {
  if (!properties(kernel_.kernel).smooth) return Interpolator::sums_at_centres(places, weights, columns, context);
  return checked_sums(kernel_, centres_, places, weights, columns, {adjoint_order, 0, adjoint_accuracy}, context).sums;
}

std::size_t IterativeInterpolator::bytes_for(std::size_t m) { return SchwarzPreconditioner::bytes_for(m) + m * sizeof(Vec3); }

std::size_t IterativeInterpolator::peak_bytes(std::size_t m, std::size_t columns) {
  return bytes_for(m) + FastSums::bytes_for(m, m, 10) + m * columns * sizeof(double) * (2 * most_iterations + 10);
}

}  // namespace deform
