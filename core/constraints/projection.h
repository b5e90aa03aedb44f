// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "core/base/types.h"

namespace deform {

/// The parameters of the shape last fitted to a set of points (plane, axis and radius, rotation, ...); empty before the first
/// fit. The next fit starts from them.
using ShapeParameters = std::vector<double>;

/// A constraint to first order about the fitted shape: row r = i * rows_per_point + s belongs to point i, and
///   residual(r) + normals[r] . dx_i + parameters.row(r) . dq  [+ partner_normals[r] . dx_partners[r]]
/// is its distance from the shape after point i has moved by dx_i (and its partner, in relations between two points) and the
/// shape by dq. The squared residuals add up to the result of project(). Minimizing the sum of squares over dq alone gives the
/// derivative of the projection up to the curvature of the shape times the residual (Gauss-Newton).
struct Linearization {
  std::size_t rows_per_point = 1;  ///< 1 for surfaces, 2 for curves, 3 for points
  std::vector<Vec3> normals;       ///< zero for an inactive row (a bound that holds)
  Eigen::VectorXd residual;
  std::vector<std::uint32_t> partners;  ///< partner of each row; empty without partners
  std::vector<Vec3> partner_normals;    ///< as long as partners
  /// rows x q with small q. Columns have different units and may be linearly dependent (a cylinder fitted to coplanar points).
  Eigen::MatrixXd parameters;
};

/// The projection of a set of points onto the configurations that satisfy a geometric constraint, that is the nearest one in the
/// least-squares sense (thesis 8.5, eq. 8.15; Bouaziz et al. 2012). The points are those of all regions of the constraint, in
/// order; lengths are in their units. Immutable; any number of threads may call it at once.
class Projection {
 public:
  Projection() = default;
  Projection(const Projection&) = delete;
  Projection& operator=(const Projection&) = delete;
  virtual ~Projection() = default;

  virtual std::string_view kind() const = 0;  ///< "plane", "circle", ...
  virtual std::size_t point_count() const = 0;
  /// Whether the projection commutes with translations of all its points. If so, the translation of the set is free in the global
  /// step (one extra unknown per set instead of mean-centring). False for a given plane, say.
  virtual bool moves_with_its_points() const { return true; }
  /// Whether the constraint consists of inequalities, so that rows of linearize() are active only where they are violated.
  virtual bool has_bounds() const { return false; }

  /// Writes the projection of x to `out` (both of size point_count(), not overlapping) and returns the sum of |x - out|^2. Never
  /// fails: degenerate input (coincident or collinear points) is projected onto one of the nearest configurations.
  virtual double project(std::span<const Vec3> x, std::span<Vec3> out, ShapeParameters& shape) const = 0;

  /// Applies the derivative of the projection at x to dx, with `shape` as set by project() at x. A projection is the gradient of
  /// a function, so its derivative is symmetric, and this serves both forward and adjoint derivatives.
  virtual void derivative(std::span<const Vec3> x, const ShapeParameters& shape, std::span<const Vec3> dx,
                          std::span<Vec3> out) const = 0;

  /// The constraint errors shown in reports.
  struct Misfit {
    double largest = 0, squares = 0;  ///< largest error, sum of squared errors
    std::size_t count = 0;            ///< number of errors
  };
  virtual Misfit misfit(std::span<const Vec3> x, std::span<const Vec3> y) const;

  /// Linearizes the constraint at x, with `shape` as set by project() at x.
  virtual Linearization linearize(std::span<const Vec3> x, const ShapeParameters& shape) const = 0;
};

}  // namespace deform
