// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/deformers/ffd/held_inverse.h"
#include "core/numerics/dense/thin_svd.h"
#include "core/numerics/sparse/function_rows.h"

namespace deform {

/// Direct manipulation (thesis 3.3, eq. 3.5 to 3.7): the pseudo-inverse of the m x k matrix Phi of the functions at the held
/// points, that is the handle and fixed points. Singular values up to `clamp` times the largest one count as zero (eq. 3.6),
/// because they would move control points far for little gain.
///
/// Points in the same cell of a lattice have the same functions, so their rows are first compressed by QR to as many as there are
/// functions: the cost of the decomposition then depends on the lattice and not on the number of points. Functions that are zero
/// at all held points get the coefficient 0. Immutable; any thread.
class ClampedInverse : public HeldInverse {
 public:
  /// Limits of the clamp. Smaller singular values are dominated by rounding.
  static constexpr double least_clamp = 1e-15, largest_clamp = 0.5;
  /// The largest number of functions that are nonzero at held points.
  static constexpr std::size_t most_functions = 4000;

  /// `held` are the held points, as rows of `rows`. The automatic clamp is among 1e-1, 1e-1.25 .. 1e-8 the point of slope -1 on
  /// the L-curve of the typical fields (misfit, of which less than 1e-7 of the fields does not count, against motion of the
  /// control points, both logarithmic: Reginska 1996; Hansen, Rank-Deficient and Discrete Ill-Posed Problems, 7.5), or the next
  /// larger one that moves control points by at most most_motion for the waves, as far as the misfit of the fields stays below
  /// 1e-6 of them at every held point, 1e-5 where control points then keep within most_motion, or 3e-5 if all points are those of
  /// one handle, as affine motions of all say little then. Throws Error(invalid_argument) for more than most_functions functions,
  /// Error(numerical_failure) if all functions are zero at all held points, and what thin_svd() and the context throw.
  ClampedInverse(const FunctionRows& rows, const std::vector<PointId>& held, const Options& options, const RunContext& context);

  /// With so many kinds of sums that are checked. Throws as the constructor does for too many functions.
  static Bytes estimate(const FunctionRows& rows, const std::vector<PointId>& held, std::size_t kinds = 1);
  /// The same if every function is nonzero at every held point.
  static Bytes estimate(std::size_t held, std::size_t functions, std::size_t kinds = 1);

  /// The ratio of the largest to the smallest singular value in use.
  double condition() const override { return largest_ / values_[values_.size() - 1]; }
  std::size_t rank() const { return static_cast<std::size_t>(values_.size()); }
  /// The number of functions that are nonzero at some held point.
  std::size_t functions() const { return active_.size(); }
  std::size_t bytes() const override;
  std::string note() const override;

  /// Phi^+ h: k x c from m x c.
  Solution solution(const Eigen::MatrixXd& h) const override;
  /// Returns (Phi^+)^T g: m x c from k x c.
  Eigen::MatrixXd adjoint(const Eigen::MatrixXd& g) const override;
  /// First-order perturbation of Phi^+ (Daleckii and Krein's formula for functions of singular values) by rounding errors that
  /// are independent in the bases of singular vectors, whose standard deviation was measured. The gap between singular values
  /// that are kept and those left out counts only for the values next to it, with what the column has along their vectors: a
  /// column may be missed by much of what the others leave out, or no function meets, and not depend on the gap at all. So it is
  /// with symmetric models, whose singular values come in pairs, one of which belongs to motions that they do not make.
  Eigen::VectorXd uncertainty(std::size_t kind, const Eigen::VectorXd& parts, const Sizes& sizes) const override;

 private:
  /// Held points with the same functions.
  struct Group {
    std::vector<std::int64_t> points;  ///< positions in `held`
    Eigen::MatrixXd Q;                 ///< points x rows, orthonormal columns; empty if rows and points are the same
    Eigen::Index first = 0, rows = 0;  ///< rows in the compressed matrix
  };
  static std::vector<Group> groups_of(const FunctionRows& rows, const std::vector<PointId>& held);
  Eigen::MatrixXd compressed(const Eigen::MatrixXd& h) const;
  /// The transpose: values at the held points from compressed rows.
  Eigen::MatrixXd at_points(const Eigen::MatrixXd& rows) const;
  double automatic_clamp(const Eigen::MatrixXd& U, const Eigen::VectorXd& values, const Eigen::MatrixXd& fields) const;
  double strengthened(double clamp, const ThinSvd& svd, const Typical& typical) const;
  void keep(const ThinSvd& svd);
  void look_at(const SparseRows& sums, const Eigen::MatrixXd& V);

  std::int64_t columns_ = 0;
  std::size_t held_ = 0;
  std::vector<Group> groups_;
  Eigen::Index compressed_rows_ = 0;
  std::vector<std::int64_t> active_;  ///< functions that are nonzero at some held point, ascending
  double clamp_ = 0;
  double largest_ = 0;       ///< singular value
  Eigen::MatrixXd U_, V_;    ///< compressed rows x (rank + those of left_), functions() x rank
  Eigen::VectorXd values_;   ///< rank
  Eigen::VectorXd left_;     ///< singular values left out that are over half of the smallest in use, descending
  Eigen::Index beside_ = 0;  ///< the first singular value in use that is less than twice the smallest one

  /// What the errors of sums at the checked places depend on, with the parts g_i of the rows along V.
  struct Sums {
    Eigen::ArrayXd of_misfit;        ///< the squared norms of g_i / value_i^2 in use
    Eigen::ArrayXd of_coefficients;  ///< the squared norms of g_i / value_i in use
    Eigen::ArrayXd outside;          ///< the squared norms of what is not along those in use
    Eigen::MatrixXf near_squares;    ///< places x (rank - beside_ + those of left_): g_i^2
  };
  std::vector<Sums> sums_;
  double change_ = 0;  ///< standard deviation of rounding errors of Phi in the bases of singular vectors
};

}  // namespace deform
