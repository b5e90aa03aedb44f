// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/numerics/dense/blocked_qr.h"
#include "core/numerics/interpolation/interpolator.h"

namespace deform {

/// RBF least squares with a growing number of centres (thesis 7.5, eq. 7.1). Values are given at m points, of which the first k
/// in a certain order are centres. The system
///
///   [ Phi_k   P ] [w]   [f]      Phi_k: kernel between the m points and the k centres, m x k
///   [ P_k^T   0 ] [c] = [0]      P, P_k: polynomials at the points and the centres, m x q, k x q
///
/// is solved in the least-squares sense, side conditions included (without them the error far away from the points is ten times
/// larger). k = m gives the interpolant of the dense solvers. The matrix is factored once, A = Q R, by appending columns in
/// blocks. Since this leaves earlier columns unchanged, one factorization serves all smaller k, and a request uses the first k
/// that meets its tolerance. Preparation takes about 2 m k^2 operations and 8 m k bytes, a request 12 m k operations.
class LeastSquaresInterpolator : public Interpolator {
 public:
  /// Only one of several coincident points gets a weight. Throws Error(invalid_argument) naming the field: no points, non-finite
  /// coordinates or samples, a polynomial degree below what the kernel needs, samples with a wrong number of rows, greedy without
  /// samples, a negative tolerance. Throws out_of_budget if not even one centre fits into the memory limit; cancelled,
  /// deadline_exceeded. Reports "factor" progress as the fraction of the allowed centres.
  LeastSquaresInterpolator(std::vector<Vec3> centres, const InterpolationOptions& options, const RunContext& context = {});

  Solver solver() const override { return Solver::incremental_qr; }
  /// The largest k. It is below the allowed number of centres if the samples need no more, or if the remaining columns depend on
  /// the preceding ones to working precision.
  std::size_t weighted() const override { return order_.size(); }
  const std::vector<std::uint32_t>& order() const { return order_; }  ///< the centres, as indices of points
  std::size_t bytes() const override;
  /// An upper bound of bytes() for k centres of m points.
  static std::size_t bytes_for(std::size_t m, std::size_t k);

  /// Uses the first k with RMS error <= tolerance for one field F (m x columns; three columns for displacements). The tolerance
  /// is in the units of the values. Missing it is not an error. Throws Error(invalid_argument) for a wrong number of rows,
  /// non-finite values or a negative tolerance.
  Interpolants interpolate(const Eigen::MatrixXd& F, double tolerance, const RunContext& context = {}) const override;
  /// The adjoint for all weighted() centres.
  Eigen::MatrixXd adjoint(Eigen::MatrixXd B, const RunContext& context = {}) const override;
  /// The RMS error for each k = 0 .. weighted(), nonincreasing: quality against cost.
  std::vector<double> errors(const Eigen::MatrixXd& F) const;

 private:
  std::span<const Vec3> weighted_centres(std::size_t weights) const override { return std::span(chosen_).first(weights); }
  std::size_t allowed(const InterpolationOptions& options) const;
  void append_polynomials(const RunContext& context);
  std::size_t append(std::span<const std::uint32_t> indices, const RunContext& context);
  void prepare_farthest(const InterpolationOptions& options, std::size_t most, const RunContext& context);
  void prepare_greedily(const InterpolationOptions& options, std::size_t most, const RunContext& context);
  void keep(std::size_t centres);
  Eigen::MatrixXd residual(Eigen::MatrixXd projected, std::size_t centres, std::size_t panels) const;
  bool met(const Eigen::MatrixXd& projected, const InterpolationOptions& options, std::size_t& centres) const;

  std::vector<std::uint32_t> order_;
  std::vector<Vec3> chosen_;  ///< coordinates, in this order
  BlockedQr qr_;
};

}  // namespace deform
