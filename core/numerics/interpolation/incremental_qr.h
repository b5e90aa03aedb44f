#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/dense/blocked_qr.h"
#include "core/numerics/interpolation/solver.h"
#include "core/numerics/kernels/kernel.h"
#include "core/numerics/kernels/polynomial.h"
#include "core/numerics/sampling/farthest_points.h"

namespace deform {

struct IncrementalQrOptions {
  RadialKernel kernel;
  int polynomial_degree = 1;  ///< at least the kernel's order - 1, at most 2
  CentreOrder order = CentreOrder::farthest_point;
  std::size_t most_centres = 0;  ///< 0 = as many as there are points
  std::size_t memory_limit = 0;  ///< bytes; fewer centres are prepared when more do not fit; 0 = unlimited
  /// Values that are typical of what will be asked, m x columns, columns_per_field columns a field (the displacements of the
  /// largest design). Greedy needs some; otherwise they may be empty. No more centres are prepared than it takes to bring the RMS
  /// error of every field down to sample_tolerance (units of the samples; 0: they do not end the preparation).
  Eigen::MatrixXd samples;
  double sample_tolerance = 0;
  std::size_t columns_per_field = 3;  ///< at least 1
};

/// RBF least squares with a growing number of centres (thesis 7.5, eq. 7.1). The first k of the m constraint points in some order
/// are centres, and
///
///   [ Phi_k   P ] [w]   [f]      Phi_k: kernel between the m points and the k centres, m x k
///   [ P_k^T   0 ] [c] = [0]      P, P_k: polynomials at the points and at the centres, m x q and k x q
///
/// is solved in the sense of least squares, side conditions included (without them the field is ten times worse far away from the
/// points). k = m gives the interpolant of InterpolationSystem. The matrix is factored once, A = Q R, by columns appended in
/// blocks; as these leave earlier columns alone, one preparation serves every smaller k, and a request takes the first k within
/// its tolerance. Preparation takes about 2 m k^2 operations and 8 m k bytes, a request 12 m k operations.
///
/// Coordinates should be of unit size. Immutable after construction; any number of threads may solve at once. No result depends
/// on the number of threads.
class IncrementalQr {
 public:
  /// points: m x 3; of coincident ones one becomes a centre. Throws Error(invalid_argument) naming the field: no points,
  /// non-finite coordinates or samples, a polynomial degree that does not suit the kernel, samples of another number of rows,
  /// greedy without samples, a negative tolerance; out_of_budget when not even one centre fits; cancelled, deadline_exceeded.
  /// Progress "factor": the share of the centres allowed.
  IncrementalQr(std::vector<Vec3> points, const IncrementalQrOptions& options, const RunContext& context = {});

  std::size_t size() const { return points_.size(); }  ///< m
  /// The largest k that can be had. Less than allowed when the samples need no more, or when what is left are columns that depend
  /// on those before to working precision.
  std::size_t prepared() const { return order_.size(); }
  const std::vector<std::uint32_t>& order() const { return order_; }  ///< the centres as indices of points
  const std::vector<Vec3>& centres() const { return centres_; }       ///< in that order
  const PolynomialSpace& polynomials() const { return polynomials_; }
  std::size_t bytes() const;
  /// Upper bound for k centres of m points.
  static std::size_t bytes_for(std::size_t m, std::size_t k);

  struct Solution {
    std::size_t centres = 0;       ///< k
    Eigen::MatrixXd coefficients;  ///< (k + q) x columns: weights of the first k centres, then those of the polynomials
    /// sqrt((sum over the points of |error|^2 + what is left in the side conditions, squared) / m), units of the values. Does
    /// not rise with k.
    double rms = 0;
    double largest_error = 0;  ///< max over the points of |error|
    bool converged = false;    ///< rms <= tolerance; else k is prepared()
  };
  /// The first k with RMS <= tolerance for one field F (m x columns; three of a displacement field). tolerance >= 0, units of the
  /// values. Not reaching it is a result. Throws Error(invalid_argument): another number of rows, non-finite values, a negative
  /// tolerance.
  Solution solve(const Eigen::MatrixXd& F, double tolerance) const;
  /// RMS error for k = 0 .. prepared(): quality against cost. Does not rise.
  std::vector<double> errors(const Eigen::MatrixXd& F) const;

  /// The transpose of "values F at the points to coefficients" with all prepared() centres: B ((prepared() + q) x columns, rows
  /// as in Solution) to m x columns.
  Eigen::MatrixXd adjoint(const Eigen::MatrixXd& B) const;

  /// Values of a solution: n x columns, row by row.
  std::vector<double> values(const Solution& solution, std::span<const Vec3> at, const RunContext& context = {}) const;

 private:
  std::size_t allowed(const IncrementalQrOptions& options) const;
  void append_polynomials(const RunContext& context);
  std::size_t append(std::span<const std::uint32_t> indices, const RunContext& context);
  void prepare_farthest(const IncrementalQrOptions& options, std::size_t most, const RunContext& context);
  void prepare_greedily(const IncrementalQrOptions& options, std::size_t most, const RunContext& context);
  void keep(std::size_t centres);
  Eigen::MatrixXd with_side_conditions(const Eigen::MatrixXd& F) const;
  Eigen::MatrixXd residual(Eigen::MatrixXd projected, std::size_t centres, std::size_t panels) const;
  bool met(const Eigen::MatrixXd& projected, const IncrementalQrOptions& options, std::size_t& centres) const;

  std::vector<Vec3> points_;
  RadialKernel kernel_;
  PolynomialSpace polynomials_;
  std::vector<std::uint32_t> order_;
  std::vector<Vec3> centres_;
  BlockedQr qr_;
};

}  // namespace deform
