// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/sparse/function_rows.h"

namespace deform {

/// Direct manipulation (thesis 3.3, eq. 3.5 to 3.7): the pseudo-inverse of the m x k matrix Phi of the functions at the held
/// points. Singular values up to `clamp` times the largest one count as zero (eq. 3.6), since they move control points far to
/// mend little.
///
/// Points of one cell of the lattice share their functions, so their rows are first turned into as many as there are functions
/// (QR): the decomposition then depends on the lattice and not on the number of points. Functions that reach no held point get 0.
/// Immutable; any thread.
class ClampedInverse {
 public:
  /// Smallest clamp: below, singular values are rounding.
  static constexpr double least_clamp = 1e-15, largest_clamp = 0.5;
  /// Functions that may reach held points.
  static constexpr std::size_t most_functions = 4000;

  /// held: rows of `rows`. clamp: 0 = automatic, the point of the L-curve of `fields` (m x f, what will be prescribed) with slope
  /// -1 (misfit against motion of the control points, both logarithmic: Reginska 1996; Hansen, Rank-Deficient and Discrete
  /// Ill-Posed Problems, 7.5), among 1e-1, 1e-1.25 .. 1e-8. Throws Error(invalid_argument) for more than most_functions,
  /// Error(numerical_failure) when no function reaches a held point, and what thin_svd() and the context throw.
  ClampedInverse(const FunctionRows& rows, const std::vector<PointId>& held, double clamp, const Eigen::MatrixXd& fields,
                 const RunContext& context);

  /// Upper bounds of bytes() and of what the constructor needs beside them, from the rows. Throws as the constructor for too many
  /// functions.
  struct Bytes {
    std::size_t resident = 0, peak = 0;
    std::size_t functions = 0;
    double flops = 0;
  };
  static Bytes estimate(const FunctionRows& rows, const std::vector<PointId>& held);
  /// The same where every function reaches every held point.
  static Bytes estimate(std::size_t held, std::size_t functions);

  double clamp() const { return clamp_; }
  /// Of what is kept: largest over smallest singular value.
  double condition() const { return largest_ / values_[values_.size() - 1]; }
  std::size_t rank() const { return static_cast<std::size_t>(values_.size()); }
  /// Functions that reach held points.
  std::size_t functions() const { return active_.size(); }
  std::size_t bytes() const;

  /// Phi^+ h: k x c from m x c.
  Eigen::MatrixXd solve(const Eigen::MatrixXd& h) const;
  /// (Phi^+)^T g: m x c from k x c.
  Eigen::MatrixXd adjoint(const Eigen::MatrixXd& g) const;
  /// How far a column of the solution may be off in the 2-norm, from rounding, for one whose length is `size` and whose misfit
  /// has the length `misfit` (first-order perturbation of truncated singular values).
  double uncertainty(double size, double misfit) const;

 private:
  /// Held points that share their functions.
  struct Group {
    std::vector<std::int64_t> points;  ///< positions in `held`
    Eigen::MatrixXd Q;                 ///< points x rows, orthonormal columns; empty: the rows are the points themselves
    Eigen::Index first = 0, rows = 0;  ///< of the compressed matrix
  };
  static std::vector<Group> groups_of(const FunctionRows& rows, const std::vector<PointId>& held);
  Eigen::MatrixXd compressed(const Eigen::MatrixXd& h) const;
  double automatic_clamp(const Eigen::MatrixXd& U, const Eigen::VectorXd& values, const Eigen::MatrixXd& fields) const;

  std::int64_t columns_ = 0;
  std::size_t held_ = 0;
  std::vector<Group> groups_;
  Eigen::Index compressed_rows_ = 0;
  std::vector<std::int64_t> active_;  ///< functions that reach held points, ascending
  double clamp_ = 0;
  double largest_ = 0, left_out_ = 0;  ///< singular values: the largest of all and of those left out
  Eigen::MatrixXd U_, V_;              ///< compressed rows x rank, functions() x rank
  Eigen::VectorXd values_;             ///< rank
};

}  // namespace deform
