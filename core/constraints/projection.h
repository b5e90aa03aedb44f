// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Dense>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "core/base/types.h"

namespace deform {

/// Parameters of the shape that was fitted to a set last (plane, axis and radius, rotation...); empty before the first fit.
/// Handing it back in starts the next fit from there.
using ShapeParameters = std::vector<double>;

/// A constraint to first order about the fitted shape: row r = i * rows_per_point + s belongs to point i, and
///   residual(r) + normals[r] . dx_i + parameters.row(r) . dq  [+ partner_normals[r] . dx_partners[r]]
/// is its distance from the shape after moving point i by dx_i (its partner, in relations between two points) and the shape by
/// dq; the squares of the residuals add up to what project() returns. Minimizing the sum of squares over dq alone gives the
/// derivative of the projection up to the curvature of the shape times the residual (Gauss-Newton).
struct Linearization {
  std::size_t rows_per_point = 1;  ///< 1 for surfaces, 2 for curves, 3 for points
  std::vector<Vec3> normals;       ///< zero for a row that does not count (a bound that is not active)
  Eigen::VectorXd residual;
  std::vector<std::uint32_t> partners;  ///< per row, or empty without partners
  std::vector<Vec3> partner_normals;    ///< as long as partners
  /// rows x q, small q; columns of different units, which may depend on each other (a cylinder on points of a plane).
  Eigen::MatrixXd parameters;
};

/// The projection of a set of points on all configurations that satisfy a geometric constraint: the smallest change, in the least
/// squares sense (thesis 8.5, eq. 8.15; Bouaziz et al. 2012). The points of all its regions stand one after the other. Immutable;
/// any number of threads may call it at once. Lengths in whatever unit the points have.
class Projection {
 public:
  Projection() = default;
  Projection(const Projection&) = delete;
  Projection& operator=(const Projection&) = delete;
  virtual ~Projection() = default;

  virtual std::string_view kind() const = 0;  ///< "plane", "circle", ...
  virtual std::size_t point_count() const = 0;
  /// Whether the projection moves along when all its points are translated: then the translation of the set is free in the global
  /// step (one extra unknown per set instead of mean-centring). False e.g. for a plane that is given.
  virtual bool moves_with_its_points() const { return true; }
  /// Whether it holds distances within bounds, so that rows of linearize() count only where points are out of them.
  virtual bool has_bounds() const { return false; }

  /// out = projection of x (both point_count() long; may not overlap); returns the sum of |x - out|^2. Never fails: degenerate
  /// input (coincident or collinear points) projects on some nearest configuration and is reported by the residual.
  virtual double project(std::span<const Vec3> x, std::span<Vec3> out, ShapeParameters& shape) const = 0;

  /// out = derivative of the projection at x, where project() left `shape`, applied to dx. A projection is the gradient of a
  /// function, so its derivative is symmetric: this serves forward and backward.
  virtual void derivative(std::span<const Vec3> x, const ShapeParameters& shape, std::span<const Vec3> dx,
                          std::span<Vec3> out) const = 0;

  /// What a report says of points x whose projections are y: by default how far they are apart.
  struct Misfit {
    double largest = 0, squares = 0;  ///< of an error, and the sum of its squares
    std::size_t count = 0;            ///< of errors
  };
  virtual Misfit misfit(std::span<const Vec3> x, std::span<const Vec3> y) const;

  /// At x, where project() left `shape`.
  virtual Linearization linearize(std::span<const Vec3> x, const ShapeParameters& shape) const = 0;
};

}  // namespace deform
