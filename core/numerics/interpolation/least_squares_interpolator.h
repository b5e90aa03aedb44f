// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/numerics/dense/blocked_qr.h"
#include "core/numerics/interpolation/interpolator.h"

namespace deform {

/// RBF least squares with a growing number of centres (thesis 7.5, eq. 7.1). Values are given at m places; the first k of them in
/// some order have weights, and
///
///   [ Phi_k   P ] [w]   [f]      Phi_k: kernel between the m places and the k of them, m x k
///   [ P_k^T   0 ] [c] = [0]      P, P_k: polynomials at all places and at the k, m x q and k x q
///
/// is solved in the sense of least squares, side conditions included (without them the field is ten times worse far away from the
/// places). k = m gives the interpolant of the dense solvers. The matrix is factored once, A = Q R, by columns appended in
/// blocks; as these leave earlier columns alone, one preparation serves every smaller k, and a request takes the first k within
/// its tolerance. Preparation takes about 2 m k^2 operations and 8 m k bytes, a request 12 m k operations.
class LeastSquaresInterpolator : public Interpolator {
 public:
  /// Of coincident places one gets a weight. Throws Error(invalid_argument) naming the field: no places, non-finite coordinates
  /// or samples, a polynomial degree that does not suit the kernel, samples of another number of rows, greedy without samples, a
  /// negative tolerance; out_of_budget when not even one centre fits; cancelled, deadline_exceeded. Progress "factor": the share
  /// of the centres allowed.
  LeastSquaresInterpolator(std::vector<Vec3> centres, const InterpolationOptions& options, const RunContext& context = {});

  Solver solver() const override { return Solver::incremental_qr; }
  /// The largest k that can be had. Less than allowed when the samples need no more, or when what is left are columns that depend
  /// on those before to working precision.
  std::size_t weighted() const override { return order_.size(); }
  const std::vector<std::uint32_t>& order() const { return order_; }  ///< which places, as indices
  std::size_t bytes() const override;
  /// Upper bound for k centres of m places.
  static std::size_t bytes_for(std::size_t m, std::size_t k);

  /// The first k with RMS <= tolerance for one field F (m x columns; three of a displacement field). tolerance >= 0, units of the
  /// values. Not reaching it is a result. Throws Error(invalid_argument): another number of rows, non-finite values, a negative
  /// tolerance.
  Interpolants interpolate(const Eigen::MatrixXd& F, double tolerance, const RunContext& context = {}) const override;
  /// With all weighted() centres.
  Eigen::MatrixXd adjoint(Eigen::MatrixXd B, const RunContext& context = {}) const override;
  /// RMS error for k = 0 .. weighted(): quality against cost. Does not rise.
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
  std::vector<Vec3> chosen_;  ///< in that order
  BlockedQr qr_;
};

}  // namespace deform
