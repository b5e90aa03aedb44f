// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/interpolation/solver.h"
#include "core/numerics/kernels/kernel.h"
#include "core/numerics/kernels/polynomial.h"

namespace deform {

struct InterpolationOptions {
  RadialKernel kernel;        ///< with a parity: values, polynomials and interpolants have it too (not for the iterative solver)
  int polynomial_degree = 1;  ///< at least the kernel's order - 1, at most 2
  Solver solver = Solver::automatic;
  std::size_t memory_limit = 0;  ///< bytes that the fallback, or incremental QR, may take; 0 = unlimited

  // The rest is for incremental QR.
  CentreOrder order = CentreOrder::farthest_point;
  std::size_t most_centres = most_incremental_centres;
  /// Values that are typical of what will be asked, m x columns, columns_per_field columns a field (the displacements of the
  /// largest design). Greedy needs some; otherwise they may be empty. No more centres are prepared than it takes to bring the RMS
  /// error of every field down to sample_tolerance (units of the samples; 0: they do not end the preparation).
  Eigen::MatrixXd samples;
  double sample_tolerance = 0;
  std::size_t columns_per_field = 3;  ///< at least 1
};

/// Interpolants of some columns of values, and how good they are.
struct Interpolants {
  /// (m + q) x columns: weights, then those of the polynomials; of incremental QR k weights, those of its first k centres.
  Eigen::MatrixXd coefficients;
  /// Iterative: largest |interpolant - value| over the centres and columns, with the error of the sums; incremental QR: largest
  /// length of a row of errors over the points; else 0, not measured.
  double residual = 0;
  std::vector<std::uint32_t> worst{};  ///< some of the centres where it is largest, where it was measured at all of them
  Eigen::VectorXd residuals{};  ///< the same per column: largest |interpolant - value| over the centres; empty where not measured
  /// Iterative: residual <= tolerance; incremental QR: rms <= tolerance, else it took all its centres; else false when the
  /// factor has no correct digits, so that refinement does not help.
  bool converged = true;
  /// Cholesky, LDL^T: how far the coefficients may be off, as the last step of refinement shows; else empty.
  Eigen::MatrixXd uncertainty;
  int iterations = 0;
  int order = 0;  ///< iterative: of the fast sums that are good enough for these weights at the centres
  double tolerance =
      0;  ///< iterative: twice what values() may be off by, in the units of the values; at first that was asked for
  /// Incremental QR: sqrt((sum over the points of |error|^2 + what is left in the side conditions, squared) / m), units of the
  /// values. Does not rise with k.
  double rms = 0;
};

/// The largest error of all points is taken for so many times that of the points that are checked.
inline constexpr double error_margin = 2;

/// The numbers of the rows with the largest entries, at most 32, the largest first.
std::vector<std::uint32_t> worst_rows(const Eigen::MatrixXd& residual);

/// An RBF interpolant (thesis 3.5) with everything but the values prepared. Coordinates should be of unit size. Immutable after
/// construction; any number of threads may use it at once. No result depends on the number of threads.
class Interpolator {
 public:
  virtual ~Interpolator() = default;
  Interpolator(const Interpolator&) = delete;
  Interpolator& operator=(const Interpolator&) = delete;

  std::size_t size() const { return centres_.size(); }  ///< m
  const std::vector<Vec3>& centres() const { return centres_; }
  const RadialKernel& kernel() const { return kernel_; }
  const PolynomialSpace& polynomials() const { return polynomials_; }
  const std::vector<std::string>& notes() const { return notes_; }

  virtual Solver solver() const = 0;  ///< the one used
  /// How many of the centres may have a weight.
  virtual std::size_t weighted() const { return size(); }
  virtual double condition() const { return 0; }  ///< 0 = not estimated
  virtual std::size_t bytes() const = 0;

  /// Interpolants of the values F (m x columns) at the centres. `tolerance`, in the units of the values, is for the solvers that
  /// have one: of the iterative one for every column, of incremental QR for the RMS error of one field; the others always deliver
  /// all digits. Not reaching it is a result. Throws Error(cancelled), deadline_exceeded.
  virtual Interpolants interpolate(const Eigen::MatrixXd& F, double tolerance, const RunContext& context = {}) const = 0;
  /// Their values: n x columns, row by row.
  std::vector<double> values(const Interpolants& interpolants, std::span<const Vec3> points,
                             const RunContext& context = {}) const;
  /// And what sums that are not direct may be wrong by, as far as samples of the points show it.
  std::vector<double> values(const Interpolants& interpolants, std::span<const Vec3> points, double& error,
                             const RunContext& context) const;
  /// The same with direct sums, whichever the solver: right to rounding.
  std::vector<double> direct_values(const Interpolants& interpolants, std::span<const Vec3> points,
                                    const RunContext& context = {}) const;
  /// Wanted (n x columns) - values with twice the digits of a double, where direct sums lose too many.
  Eigen::MatrixXd accurate_residual(const Interpolants& interpolants, std::span<const Vec3> points, const Eigen::MatrixXd& wanted,
                                    const RunContext& context = {}) const;
  /// What rounding makes of values() there, about: that of the largest sum of absolute values of all terms.
  double rounding(const Interpolants& interpolants, std::span<const Vec3> points, const RunContext& context = {}) const;
  /// Goes on from interpolants of F to a smaller tolerance; only the iterative one has anything to add.
  virtual Interpolants refine(Interpolants interpolants, const Eigen::MatrixXd& /*F*/, double /*tolerance*/,
                              const RunContext& /*context*/) const {
    return interpolants;
  }
  /// Row i = sum over places j of phi(|centre i - place j|) * weights[j]: m x columns, row by row; adjoint of the sums above.
  virtual std::vector<double> sums_at_centres(std::span<const Vec3> places, std::span<const double> weights, std::size_t columns,
                                              const RunContext& context) const;
  /// Adjoint of "values F at the centres to coefficients": B ((m + q) x columns, derivatives by weights and by coefficients of
  /// the polynomials) to m x columns.
  virtual Eigen::MatrixXd adjoint(Eigen::MatrixXd B, const RunContext& context = {}) const = 0;

 protected:
  Interpolator(std::vector<Vec3> centres, const RadialKernel& kernel, int polynomial_degree);
  /// Of the kernels with the weights of some interpolants (as many of them as there are rows): n x columns, row by row.
  virtual std::vector<double> weighted_sums(const Interpolants& interpolants, std::span<const double> weights,
                                            std::span<const Vec3> points, double& error, const RunContext& context) const;
  /// The centres of so many weights.
  virtual std::span<const Vec3> weighted_centres(std::size_t /*weights*/) const { return centres_; }
  /// [F; 0], (m + q) x columns.
  Eigen::MatrixXd with_side_conditions(const Eigen::MatrixXd& F) const;

  std::vector<Vec3> centres_;
  RadialKernel kernel_;
  PolynomialSpace polynomials_;
  std::vector<std::string> notes_;  ///< what was decided and why, one sentence each
};

/// With the solver of the options. Throws Error(invalid_argument) where the solver does not take them, numerical_failure when it
/// breaks down, out_of_budget, cancelled, deadline_exceeded.
std::unique_ptr<const Interpolator> make_interpolator(std::vector<Vec3> centres, const InterpolationOptions& options,
                                                      const RunContext& context);

/// Upper bounds for m centres: of what stays besides them, and while it is made or used.
std::size_t interpolator_bytes(std::size_t m, Solver solver);
std::size_t interpolator_peak_bytes(std::size_t m, Solver solver);

}  // namespace deform
