// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/measures/faces.h"
#include "core/mesh/mesh.h"

namespace deform::measures {

/// The options of a filter.
struct SobolevOptions {
  double length = 0;               ///< r, model units, > 0: waves that are shorter than 2 pi r are damped
  FaceChoice faces;                ///< the surface
  double tolerance = 1e-10;        ///< of the solver: |b - A g| <= tolerance |b|; 1e-15 to 0.1
  std::size_t iterations = 10000;  ///< most of them per component
};

/// What is applied to a field. M is the lumped mass matrix (areas of the points, n), K the stiffness matrix of the cotangents.
enum class SobolevForm {
  density,     ///< g = (M + r^2 K)^-1 M f: a field per area becomes a smooth one of the same unit
  derivative,  ///< g = (M + r^2 K)^-1 s: the derivatives s of an objective by the points become its H1 gradient, per area
  transposed,  ///< M (M + r^2 K)^-1 w: the transpose of `density`, for chain rules
};

/// A field that was filtered, and how its system was solved.
struct Filtered {
  std::vector<double> field;   ///< as it was given, n x components
  double residual = 0;         ///< largest |b - A g| / |b| of the components, of the result
  std::size_t iterations = 0;  ///< of all components
  bool converged = true;       ///< residual <= 1.01 tolerance
};

/// The implicit Sobolev filter of node-wise fields on a surface (A. Jameson, Aerodynamic design via control theory, 1988; in weak
/// form with linear elements): of all fields v the smooth g is the one with integral(g v + r^2 grad g . grad v) = integral(f v),
/// so that `derivative` is the gradient of an objective in the inner product of H1 in place of that of L2. On an infinite plane a
/// point is spread over a distance of about r; constants stay as they are, and so does the integral of f.
///
/// A = M + r^2 K is symmetric and positive definite for any faces, since K is a sum of energies of single triangles: rims are
/// free (no flux through them), and more than two faces may meet at an edge. So `derivative` is symmetric, and `density` is
/// symmetric in the inner product of M: f . M F h = F f . M h. Points with the same coordinates in the mesh are one; the mass of
/// faces without area (below 1e-10 of their squared longest edge) is left out. Points without area, such as those inside of a
/// volume mesh, keep the value f of `density` and `transposed`, and get 0 from `derivative`.
///
/// Solved by conjugate gradients with the diagonal as preconditioner; not converging is a result. Immutable; any number of
/// threads may apply. Results have the same bits for any number of threads.
class SobolevFilter {
 public:
  /// points: n, the shape on which it is done. Throws as chosen_triangles(), Error(invalid_argument) naming `points`, `length`,
  /// `tolerance`, `iterations`.
  SobolevFilter(const Mesh& mesh, std::span<const Vec3> points, const SobolevOptions& options);

  std::size_t point_count() const { return unknown_of_.size(); }  ///< n
  /// field: n x components, point by point, finite. Throws Error(invalid_argument) naming `field`, Error(cancelled),
  /// deadline_exceeded.
  Filtered apply(std::span<const double> field, std::size_t components, SobolevForm form, const RunContext& context = {}) const;

  /// The area of each point, n; that of points with the same coordinates is the sum.
  std::vector<double> areas() const;

 private:
  struct Solution {
    std::vector<double> values;
    double residual = 0;
    std::size_t iterations = 0;
  };

  void assemble(std::span<const Triangle> triangles, std::span<const Vec3> points, const std::vector<PointId>& same);
  void multiply(const std::vector<double>& x, std::vector<double>& y, const RunContext& context) const;
  Solution solve(const std::vector<double>& b, const RunContext& context) const;

  static constexpr std::uint32_t no_unknown = ~std::uint32_t{0};
  SobolevOptions options_;
  std::vector<std::uint32_t> unknown_of_;  ///< n; points with the same coordinates share one, those without area have none
  std::vector<double> own_area_;           ///< n: the part of a point in the mass of its unknown
  std::vector<double> mass_;               ///< of unknowns
  std::vector<double> diagonal_;           ///< of A
  std::vector<std::uint64_t> starts_;      ///< unknowns + 1
  std::vector<std::uint32_t> columns_;     ///< of the other entries of A, row by row
  std::vector<double> entries_;
};

}  // namespace deform::measures
