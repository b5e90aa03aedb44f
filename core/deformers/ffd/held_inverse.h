// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "core/base/types.h"
#include "core/numerics/sparse/function_rows.h"

namespace deform {

/// Direct manipulation (thesis 3.3): a linear map from values at the held points, that is the handle and fixed points, to
/// coefficients of the functions that meet them in the least-squares sense without moving far. Immutable; any thread.
class HeldInverse {
 public:
  /// For an automatic choice: how far control points may move for waves of Typical, over the height of these.
  static constexpr double most_motion = 3;
  /// As a fraction of the prescribed values: a misfit below is none. Otherwise the weakest choice is made for affine motions of
  /// one handle, which a lattice meets ever better.
  static constexpr double least_misfit = 1e-7;
  /// Places to check, at most.
  static constexpr std::size_t most_checked = 64, most_kinds = 3;

  /// What an automatic choice is made for, as columns of values at the held points.
  struct Typical {
    /// Motions that are to be met: those of the L-curve. See typical_fields().
    Eigen::MatrixXd fields;
    /// Waves of height 1 that a design may contain besides: control points are not to move far for these. May be empty.
    Eigen::MatrixXd waves;
  };
  /// Where the errors of solutions are estimated.
  struct Checked {
    /// Sums over the coefficients, places x functions, at most most_kinds for as many places, at most most_checked.
    std::vector<SparseRows> kinds;
    double rounding = 0;  ///< standard deviation of the rounding errors of values of the functions
  };
  struct Options {
    double clamp = 0;  ///< 0: automatic
    Typical typical;
    Checked checked;
  };
  /// A solution, and what it and its error depend on: linear in the values at the held points, a column for each of theirs.
  struct Solution {
    Eigen::MatrixXd coefficients;  ///< k x c
    Eigen::MatrixXd parts;         ///< s x c, along singular vectors; no rows where uncertainty() takes none
  };
  /// The sizes of a column of a solution.
  struct Sizes {
    double coefficients = 0;  ///< their 2-norm
    double misfit = 0;        ///< the 2-norm of what held points are missed by
    double data = 0;          ///< standard deviation of the rounding errors of the values at the held points
  };
  /// Upper bounds of bytes() and of the additional memory of the constructor.
  struct Bytes {
    std::size_t resident = 0, peak = 0;
    std::size_t functions = 0;
    double flops = 0;
  };

  virtual ~HeldInverse() = default;
  /// From m x c. The result of a column does not depend on the others, bit for bit.
  virtual Solution solution(const Eigen::MatrixXd& h) const = 0;
  /// Its coefficients.
  Eigen::MatrixXd solve(const Eigen::MatrixXd& h) const { return solution(h).coefficients; }
  /// The transpose: m x c from k x c.
  virtual Eigen::MatrixXd adjoint(const Eigen::MatrixXd& g) const = 0;
  /// Estimates what rounding changes the sums of a kind over a column of a solution by, at each of the checked places. `parts`
  /// are those of the column.
  virtual Eigen::VectorXd uncertainty(std::size_t kind, const Eigen::VectorXd& parts, const Sizes& sizes) const = 0;
  /// The condition of the equations that are solved.
  virtual double condition() const = 0;
  virtual std::size_t bytes() const = 0;
  /// What was chosen, for people: one sentence.
  virtual std::string note() const = 0;
};

/// The functions that are nonzero at some held point, ascending.
std::vector<std::int64_t> reached_functions(const FunctionRows& rows, const std::vector<PointId>& held);
/// Positions in `held` by their first function: points of one cell of a lattice have the same ones. Points without any are left
/// out.
std::map<std::int64_t, std::vector<std::int64_t>> points_by_function(const FunctionRows& rows, const std::vector<PointId>& held);

}  // namespace deform
