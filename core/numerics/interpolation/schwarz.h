// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <memory>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/fast_sums/fast_sums.h"
#include "core/numerics/interpolation/saddle_factor.h"

namespace deform {

/// An approximate inverse of an RBF system with many centres: exact interpolants on overlapping subdomains, restricted to the
/// weights of their interiors (restricted additive Schwarz), then an exact interpolant of the remaining residual on a coarse set
/// with a few centres of each subdomain (Beatson, Light, Billings: Fast solution of the radial basis function interpolation
/// equations: domain decomposition methods, SIAM J. Sci. Comput. 22, 2000). The number of iterations does not depend on the
/// number of centres as long as the coarse set grows with the number of subdomains; memory and time of the preparation are linear
/// in the number of centres.
///
/// Immutable; any number of threads may call apply() at once.
class SchwarzPreconditioner {
 public:
  /// The centres are in unit coordinates. Throws Error(numerical_failure), cancelled, deadline_exceeded.
  SchwarzPreconditioner(const RadialKernel& kernel, std::span<const Vec3> centres, int polynomial_degree,
                        const RunContext& context);

  /// Returns weights (m x columns, orthogonal to the polynomials) for values (m x columns) at the centres.
  Eigen::MatrixXd apply(const Eigen::MatrixXd& values, const RunContext& context) const;

  std::size_t domains() const { return domains_.size(); }
  std::size_t bytes() const;
  /// An upper bound of bytes() for m centres.
  static std::size_t bytes_for(std::size_t m);
  /// Projects weights (m x columns) orthogonally onto the complement of the polynomials.
  void project(Eigen::MatrixXd& weights) const;
  /// An orthonormal basis of the polynomials at the centres, m x q.
  const Eigen::MatrixXd& polynomials() const { return Q_; }

 private:
  struct Domain {
    std::vector<std::uint32_t> ids;  ///< centres of the interior first
    std::size_t own = 0;
    std::size_t terms = 0;
    std::unique_ptr<SaddleFactor> factor;
  };

  void partition(std::span<const Vec3> centres);
  void overlap(Domain& domain, std::span<const Vec3> centres) const;
  std::unique_ptr<SaddleFactor> factor(std::span<const Vec3> centres, std::size_t& terms, const RunContext& context) const;
  void choose_coarse(std::span<const Vec3> centres);

  RadialKernel kernel_;
  int degree_;
  Eigen::MatrixXd Q_;
  std::vector<Domain> domains_;
  std::vector<std::uint32_t> coarse_ids_;
  std::size_t coarse_terms_ = 0;
  std::unique_ptr<SaddleFactor> coarse_;
  std::unique_ptr<const FastSums> to_coarse_;     ///< for smooth kernels
  std::vector<Vec3> all_places_, coarse_places_;  ///< for direct sums, else empty
};

}  // namespace deform
