// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <complex>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "core/numerics/interpolation/interpolator.h"

namespace deform {

/// The centres of an interpolation problem as orbits of a rotation by 2 pi / images about the first axis of the coordinates.
struct CyclicRows {
  std::size_t images = 1;  ///< order of the rotation, at least 2
  int harmonic = 0;        ///< 0 or 1, see CyclicInterpolator
  /// The first row of each orbit, and the number of rows. The rows of an orbit are the images of its first centre in their order:
  /// `images` of them, or one on the axis.
  std::vector<std::uint32_t> first{0};

  std::size_t orbits() const { return first.size() - 1; }
  std::size_t size(std::size_t orbit) const { return first[orbit + 1] - first[orbit]; }
};

/// Interpolation of values that repeat under a rotation R by theta = 2 pi / N: on image k of a centre they are
/// Re(exp(i h k theta) U) with one complex amplitude U for each orbit, h being the harmonic. The interpolant is the real part of
/// a function u with u(R x) = exp(i h theta) u(x), whose coefficients repeat likewise, so that one Hermitian system of the size
/// of the orbits is factored instead of one of all centres (a block circulant matrix is diagonal in the Fourier basis, Davis:
/// Circulant Matrices, 1979, section 5.8):
///
///   [ H   F ] [w]   [U]      H_ab = sum over k of exp(i h k theta) phi(|x_a - R^k x_b|)
///   [ F*  0 ] [c] = [0]      F_as = f_s(x_a), the polynomials with f_s(R x) = exp(i h theta) f_s(x)
///
/// With h = 1 orbits on the axis have the value 0 and no weight. For h = 0 or N = 2 the system is real. Coefficients, values and
/// centres of the interface are those of all centres; what is not of this harmonic in values, or in derivatives of adjoint(), is
/// ignored. LDL^T with refinement by accurate residuals, see DenseInterpolator.
class CyclicInterpolator : public Interpolator {
 public:
  /// Throws what DenseInterpolator throws, and Error(numerical_failure) if the polynomials of the centres are not invariant under
  /// the rotation, as quadratics are not whose centres all lie on one quadric.
  CyclicInterpolator(std::vector<Vec3> centres, CyclicRows rows, const InterpolationOptions& options, const RunContext& context);

  Solver solver() const override { return Solver::ldlt; }
  /// The condition of the matrix on the complement of the polynomials, in the 2-norm.
  double condition() const override { return condition_; }
  std::size_t bytes() const override;
  const std::vector<std::uint32_t>& representatives() const override { return representatives_; }
  Interpolants interpolate(const Eigen::MatrixXd& F, double tolerance, const RunContext& context = {}) const override;
  Eigen::MatrixXd adjoint(Eigen::MatrixXd B, const RunContext& context = {}) const override;

  /// Upper bounds of bytes(), without the centres, and of the peak of the construction, for so many orbits and rows.
  static std::size_t bytes_for(std::size_t orbits, std::size_t rows, const CyclicRows& of);
  static std::size_t peak_bytes(std::size_t orbits, std::size_t rows, const CyclicRows& of);

 private:
  using Complex = std::complex<double>;
  struct Solution {
    Eigen::MatrixXcd values, uncertainty;
    bool converged = true;
  };
  bool is_real() const { return rows_.harmonic == 0 || rows_.images == 2; }
  void find_polynomials();
  void assemble(const RunContext& context, Eigen::MatrixXcd& H) const;
  void factor(const RunContext& context);
  double projected_norm(const std::function<Eigen::VectorXcd(const Eigen::VectorXcd&)>& map) const;
  void solve(Eigen::MatrixXcd& B) const;
  Solution refined(const Eigen::MatrixXcd& B, const RunContext& context) const;
  /// exp(i h k theta).
  Complex phase(std::size_t image) const;
  /// How often the images of an orbit's centre are counted by H: N, or 1 besides the axis.
  double repeated(std::size_t orbit) const;
  /// The real coefficients of all centres and polynomials, of Re(factor u).
  Eigen::MatrixXd expanded(const Eigen::MatrixXcd& X, Complex factor) const;

  CyclicRows rows_;
  std::vector<std::uint32_t> used_;             ///< orbits with a weight
  std::vector<std::uint32_t> representatives_;  ///< first rows of the orbits
  Eigen::MatrixXcd polynomials_of_;             ///< q x q_h: f_s as combinations of the polynomials
  Eigen::MatrixXcd F_;                          ///< used orbits x q_h
  std::vector<Vec3> places_;                    ///< of the used orbits
  std::vector<double> real_;                    ///< packed factor
  std::vector<Complex> complex_;                ///< the same of a complex system
  std::vector<int> pivots_;
  double condition_ = 0;
};

}  // namespace deform
