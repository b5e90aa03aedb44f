#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/fast_sums/fast_sums.h"
#include "core/numerics/interpolation/schwarz.h"
#include "core/numerics/kernels/polynomial.h"

namespace deform {

/// The RBF interpolant of many centres to a tolerance, with memory linear in their number: flexible GMRES (Saad 1993) on the
/// complement of the polynomials with SchwarzPreconditioner and FastSums. The order of the sums is raised until what they leave
/// out, measured against direct sums at sample centres, is below the tolerance.
///
/// Immutable; any number of threads may solve at once.
class IterativeSystem {
 public:
  /// Centres in unit coordinates. Not for Wendland's kernel (Error(invalid_argument)), whose sums are not smooth.
  IterativeSystem(std::vector<Vec3> centres, const RadialKernel& kernel, int polynomial_degree, const RunContext& context);

  const std::vector<Vec3>& centres() const { return centres_; }
  const PolynomialSpace& polynomials() const { return polynomials_; }

  struct Solution {
    Eigen::MatrixXd coefficients;  ///< (m + q) x columns: weights, then those of the polynomials
    int iterations = 0;
    int order = 0;        ///< of the sums that meet the tolerance with these weights
    double residual = 0;  ///< largest |interpolant - value| over the centres, with the error of the sums
    bool converged = false;
  };
  /// B = [f; g], (m + q) x columns: values at the centres, and right-hand sides of the side conditions (0 for interpolation).
  /// `tolerance`: in the units of the values, for every column. The columns share the order of the sums, which follows the most
  /// demanding one: other groups of columns give other digits below the tolerance. Not converging is a result. Throws
  /// Error(cancelled), deadline_exceeded. Progress "solve".
  Solution solve(const Eigen::MatrixXd& B, double tolerance, const RunContext& context) const;

  std::size_t bytes() const { return preconditioner_.bytes() + centres_.size() * sizeof(Vec3); }
  static std::size_t bytes_for(std::size_t m);
  /// With what one solve of `columns` columns takes.
  static std::size_t peak_bytes(std::size_t m, std::size_t columns);

  const SchwarzPreconditioner& preconditioner() const { return preconditioner_; }

 private:
  class Solve;

  std::vector<Vec3> centres_;
  RadialKernel kernel_;
  PolynomialSpace polynomials_;
  SchwarzPreconditioner preconditioner_;
};

}  // namespace deform
