// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/kernels/kernel.h"

namespace deform {

/// The polynomials that a set of centres can tell apart: monomials up to a total degree in the coordinates of the centres' affine
/// hull (SVD of the centred centres, directions below 1e-6 of the extent are left out), without those that depend on the others
/// there (column-pivoted QR; quadratics on a sphere). On coplanar and collinear centres they are constant across the hull, the
/// minimum-norm choice. Immutable; any thread.
class PolynomialSpace {
 public:
  static constexpr std::size_t most_terms = 10;

  /// degree 0..2, or -1 for no polynomials. At least one centre. With a parity: those polynomials of that parity which the
  /// centres and their images together can tell apart (the coordinates of the reflections are axes).
  PolynomialSpace(std::span<const Vec3> centres, int degree, const Parity& parity = {});

  std::size_t terms() const { return terms_.size(); }
  int hull_dimension() const { return dimension_; }
  /// Monomials left out because they depend on the others on the centres.
  std::size_t dropped() const { return dropped_; }

  /// Values of all terms at x.
  void values(const Vec3& x, double* out) const;
  /// n x terms.
  Eigen::MatrixXd matrix(std::span<const Vec3> points) const;

 private:
  double find_axes(std::span<const Vec3> centres, const Parity& parity);
  double monomial(const Vec3& local, int term) const;
  Vec3 local(const Vec3& x) const;

  Vec3 origin_{};
  std::array<Vec3, 3> axes_{};  // orthonormal, the first dimension_ span the hull
  double scale_ = 1;            // local coordinates are about -1..1
  int dimension_ = 0;
  std::size_t dropped_ = 0;
  std::vector<int> terms_;  // indices into the table of monomials
};

/// Adds the values of polynomials to those of other fields: values n x columns, coefficients terms x columns, both row by row.
void add_polynomials(const PolynomialSpace& polynomials, std::span<const Vec3> points, std::span<const double> coefficients,
                     std::span<double> values, const RunContext& context);

}  // namespace deform
