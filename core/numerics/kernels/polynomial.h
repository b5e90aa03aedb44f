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

/// The polynomials for which a set of centres is unisolvent: monomials up to a total degree in the coordinates of the affine hull
/// of the centres (SVD of the centred coordinates; directions below 1e-6 of the extent are left out), without those that are
/// linearly dependent on the centres (column-pivoted QR; an example are quadratics on a sphere). For coplanar or collinear
/// centres they are constant across the hull, which is the minimum-norm choice. Immutable; any thread.
class PolynomialSpace {
 public:
  static constexpr std::size_t most_terms = 10;

  /// The degree is 0..2, or -1 for no polynomials; there must be a centre. With a parity, only polynomials of this parity are
  /// used, and the images of the centres are taken into account (the coordinates of the reflections are axes then).
  PolynomialSpace(std::span<const Vec3> centres, int degree, const Parity& parity = {});

  std::size_t terms() const { return terms_.size(); }
  int hull_dimension() const { return dimension_; }
  /// The number of monomials left out because they depend on the others at the centres.
  std::size_t dropped() const { return dropped_; }

  /// Writes the values of all terms at x.
  void values(const Vec3& x, double* out) const;
  /// The values of all terms at n points, n x terms.
  Eigen::MatrixXd matrix(std::span<const Vec3> points) const;

 private:
  double find_axes(std::span<const Vec3> centres, const Parity& parity);
  double monomial(const Vec3& local, int term) const;
  Vec3 local(const Vec3& x) const;

  Vec3 origin_{};
  std::array<Vec3, 3> axes_{};  // orthonormal, the first dimension_ of them span the hull
  double scale_ = 1;            // local coordinates are about -1..1
  int dimension_ = 0;
  std::size_t dropped_ = 0;
  std::vector<int> terms_;  // indices into the table of monomials
};

/// Adds polynomials with these coefficients (terms x columns, row-major) to the values at n points (n x columns, row-major).
void add_polynomials(const PolynomialSpace& polynomials, std::span<const Vec3> points, std::span<const double> coefficients,
                     std::span<double> values, const RunContext& context);

}  // namespace deform
