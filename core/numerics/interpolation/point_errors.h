// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/interpolation/dense_interpolator.h"

namespace deform {

/// Which of the points an approximate interpolant is checked at, as indices, ascending: those next to centres, those farthest
/// from them (where errors at the centres grow most), and some of all. At most `most`. Deterministic.
std::vector<std::uint32_t> check_points(std::span<const Vec3> points, std::span<const Vec3> centres, std::size_t most = 384);

/// Infinity when any is not a number.
double largest_magnitude(const Eigen::MatrixXd& errors);

/// How far interpolants that miss their values at the centres a little are from the exact one at other places. What is missing is
/// the interpolant of the residual, so an exact solution for the residual tells, with whatever the residual grows by on the way
/// to a place. Up to most_centres all centres take part; of more those around every place, the farther away the fewer of them,
/// and some of all. Shares neither the solver nor the sums with what it checks: a dense factorization and direct sums. Immutable;
/// any thread.
class PointErrors {
 public:
  static constexpr std::size_t most_centres = 3000;

  /// Places in the coordinates of the system. Throws Error(numerical_failure), cancelled, deadline_exceeded.
  PointErrors(const Interpolator& system, int polynomial_degree, std::vector<Vec3> places, const RunContext& context);

  const std::vector<Vec3>& places() const { return places_; }
  /// Whether all centres of the system take part, so that what is missing is known exactly.
  bool complete() const { return complete_; }
  /// What interpolants of F (values at all centres of the system, m x columns) are missing: the interpolant of their residual at
  /// the centres that take part. With twice the digits where the residual is near rounding. Where it is larger at other centres,
  /// it is taken for as much larger.
  struct Missing {
    Eigen::MatrixXd coefficients;  ///< as Interpolants::coefficients, of the centres that take part
    double residual = 0;           ///< largest at these
  };
  Missing missing(const Interpolator& system, const Interpolants& interpolants, const Eigen::MatrixXd& F,
                  const RunContext& context) const;
  /// Its values: exact interpolant - the one given, estimated, places x columns, units of F.
  Eigen::MatrixXd errors(const Missing& missing, const RunContext& context) const { return errors(missing, places_, context); }
  /// The same at other places.
  Eigen::MatrixXd errors(const Missing& missing, std::span<const Vec3> places, const RunContext& context) const;

  std::size_t bytes() const;
  /// Upper bounds for m centres: of bytes(), and while it is made.
  static std::size_t bytes_for(std::size_t m);
  static std::size_t peak_bytes(std::size_t m);

 private:
  Eigen::MatrixXd residual(const Interpolator& system, const Interpolants& interpolants, const Eigen::MatrixXd& F,
                           const RunContext& context) const;

  std::vector<Vec3> places_;
  std::vector<std::uint32_t> ids_;  ///< of the centres that take part
  bool complete_ = false;
  std::unique_ptr<const DenseInterpolator> exact_;
};

}  // namespace deform
