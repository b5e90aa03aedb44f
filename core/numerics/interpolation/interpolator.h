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

/// Steps of iterative refinement of direct solutions: two leave nothing of most systems; a factor with few correct digits takes
/// more, each of which wins those.
inline constexpr int usual_refinements = 2, most_refinements = 12;
/// Whether refinement that no longer contracts has done its work: what is left are the last digits or, after the usual steps have
/// contracted, what rounding lets no step remove. Sizes are norms of the correction that did not contract and of the solution.
constexpr bool refined_as_far_as_possible(int step, double correction, double solution) {
  constexpr double last_digits = 1e-12, rounding = 1e-8;
  return correction <= (step < usual_refinements ? last_digits : rounding) * solution;
}

struct InterpolationOptions {
  RadialKernel kernel;  ///< its parity, if any, applies to values, polynomials and interpolants (not for the iterative solver)
  int polynomial_degree = 1;  ///< at least the kernel's order - 1, at most 2
  Solver solver = Solver::automatic;
  std::size_t memory_limit = 0;  ///< in bytes, for the fallback and for incremental QR; 0 = unlimited

  // Options of incremental QR only:
  CentreOrder order = CentreOrder::farthest_point;
  std::size_t most_centres = most_incremental_centres;
  /// Typical values, m x columns with columns_per_field columns for each field (the displacements of the largest design, say).
  /// Required for the greedy order, otherwise optional. The preparation stops when the RMS error of every field is at most
  /// sample_tolerance, in the units of the samples; with 0 the samples do not stop it.
  Eigen::MatrixXd samples;
  double sample_tolerance = 0;
  std::size_t columns_per_field = 3;  ///< at least 1
};

/// Interpolants of several columns of values, with their accuracy.
struct Interpolants {
  /// (m + q) x columns: weights of the centres, then coefficients of the polynomials. For incremental QR (k + q) x columns, with
  /// the weights of its first k centres.
  Eigen::MatrixXd coefficients;
  /// What the rounding of the coefficients to doubles lost, as large as these, or empty: not known. Only accurate_residual() uses
  /// it. Weights can be 1e10 times the values (r^5, small patches of centres far apart), so that their rounding alone is an error
  /// of 1e-6.
  Eigen::MatrixXd rest{};
  /// Iterative: largest |interpolant - value| over the centres and columns, plus the error of the sums. Incremental QR: largest
  /// norm of a row of errors over the points. Otherwise 0, not measured.
  double residual = 0;
  Eigen::VectorXd residuals{};  ///< largest |interpolant - value| over the centres of each column, if measured
  /// Iterative: residual <= tolerance. Incremental QR: rms <= tolerance; if false, all centres were used. Otherwise false if the
  /// factor has no correct digits, so that refinement does not help.
  bool converged = true;
  /// Cholesky, LDL^T: error estimate of each coefficient, from the last step of refinement. Otherwise empty.
  Eigen::MatrixXd uncertainty;
  int iterations = 0;
  int order = 0;  ///< iterative: order of the fast sums that suffices for these weights at the centres
  double tolerance =
      /// Iterative: twice the error allowed in values(), in the units of the values; initially the requested tolerance.
      0;
  /// Incremental QR: sqrt((sum over the points of |error|^2 + squared residual of the side conditions) / m), in the units of the
  /// values. Nonincreasing in k.
  double rms = 0;
};

/// Adds a correction to the coefficients and keeps what rounding loses, in `rest`.
void add_accurately(const Eigen::MatrixXd& correction, Interpolants& to);

/// Safety factor between the largest error at the checked points and the one at all points.
inline constexpr double error_margin = 2;

/// RBF interpolation (thesis 3.5), prepared for fixed centres and any values. Coordinates should be of unit size. Immutable after
/// construction; any number of threads may use it concurrently. No result depends on the number of threads.
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

  virtual Solver solver() const = 0;  ///< the solver in use, never `automatic`
  /// The number of centres that may have a weight.
  virtual std::size_t weighted() const { return size(); }
  virtual double condition() const { return 0; }  ///< 0 = not estimated
  /// Centres of which all others are images, with the same errors; empty if there are no others.
  virtual const std::vector<std::uint32_t>& representatives() const;
  virtual std::size_t bytes() const = 0;

  /// Interpolates the values F (m x columns) at the centres. `tolerance` is in the units of the values. The iterative solver
  /// applies it to every column, incremental QR to the RMS error of one field; the dense solvers ignore it and are accurate to
  /// rounding. Missing it is not an error, see Interpolants::converged. Throws Error(cancelled), deadline_exceeded.
  virtual Interpolants interpolate(const Eigen::MatrixXd& F, double tolerance, const RunContext& context = {}) const = 0;
  /// Values of the interpolants at n points: n x columns, row-major.
  std::vector<double> values(const Interpolants& interpolants, std::span<const Vec3> points,
                             const RunContext& context = {}) const;
  /// As above; also sets `error` to the error of sums that are not direct, estimated at samples of the points.
  std::vector<double> values(const Interpolants& interpolants, std::span<const Vec3> points, double& error,
                             const RunContext& context) const;
  /// As values(), but always by direct sums, accurate to rounding.
  std::vector<double> direct_values(const Interpolants& interpolants, std::span<const Vec3> points,
                                    const RunContext& context = {}) const;
  /// The difference wanted - values (n x columns) in double-double arithmetic, with Interpolants::rest, for use where direct sums
  /// lose too many digits.
  Eigen::MatrixXd accurate_residual(const Interpolants& interpolants, std::span<const Vec3> points, const Eigen::MatrixXd& wanted,
                                    const RunContext& context = {}) const;
  /// Estimates the rounding error of values() at the points from the largest sum of absolute values of all terms.
  double rounding(const Interpolants& interpolants, std::span<const Vec3> points, const RunContext& context = {}) const;
  /// Improves interpolants of F to a smaller tolerance. Only the iterative solver does anything here.
  virtual Interpolants refine(Interpolants interpolants, const Eigen::MatrixXd& /*F*/, double /*tolerance*/,
                              const RunContext& /*context*/) const {
    return interpolants;
  }
  /// Row i = sum over places j of phi(|centre i - place j|) * weights[j]: m x columns, row-major; the adjoint of the kernel sums
  /// in values().
  virtual std::vector<double> sums_at_centres(std::span<const Vec3> places, std::span<const double> weights, std::size_t columns,
                                              const RunContext& context) const;
  /// The adjoint of the map from values F at the centres to coefficients: takes B, (m + q) x columns, derivatives with respect to
  /// weights and polynomial coefficients, and returns m x columns.
  virtual Eigen::MatrixXd adjoint(Eigen::MatrixXd B, const RunContext& context = {}) const = 0;

 protected:
  Interpolator(std::vector<Vec3> centres, const RadialKernel& kernel, int polynomial_degree);
  /// Kernel sums with the weights of some interpolants, whose number of rows may be below size(): n x columns, row-major.
  virtual std::vector<double> weighted_sums(const Interpolants& interpolants, std::span<const double> weights,
                                            std::span<const Vec3> points, double& error, const RunContext& context) const;
  /// The centres of this number of weights.
  virtual std::span<const Vec3> weighted_centres(std::size_t /*weights*/) const { return centres_; }
  /// The right-hand side [F; 0], (m + q) x columns.
  Eigen::MatrixXd with_side_conditions(const Eigen::MatrixXd& F) const;

  std::vector<Vec3> centres_;
  RadialKernel kernel_;
  PolynomialSpace polynomials_;
  std::vector<std::string> notes_;  ///< decisions of the solver with their reasons, one sentence each
};

/// Prepares interpolation with the solver of the options. Throws Error(invalid_argument) if the solver does not support them,
/// numerical_failure if it breaks down, out_of_budget, cancelled, deadline_exceeded.
std::unique_ptr<const Interpolator> make_interpolator(std::vector<Vec3> centres, const InterpolationOptions& options,
                                                      const RunContext& context);

/// Upper bounds in bytes for m centres: of the memory that the interpolator keeps besides them, and of the peak while it is
/// prepared or used.
std::size_t interpolator_bytes(std::size_t m, Solver solver);
std::size_t interpolator_peak_bytes(std::size_t m, Solver solver);

}  // namespace deform
