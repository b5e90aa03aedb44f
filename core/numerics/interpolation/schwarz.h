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

/// Approximate inverse of an RBF system with many centres: exact interpolants on overlapping subsets, of which the weights inside
/// are kept (restricted additive Schwarz), then the exact interpolant of what remains on a few centres of every subset (Beatson,
/// Light, Billings: Fast solution of the radial basis function interpolation equations: domain decomposition methods, SIAM J.
/// Sci. Comput. 22, 2000). A fixed number of iterations for any number of centres as long as the coarse set is not much smaller
/// than the subsets are many; memory and time of its preparation are linear in the number of centres.
///
/// Immutable; any number of threads may call apply() at once.
class SchwarzPreconditioner {
 public:
  /// Centres in unit coordinates. polynomials: of all centres. Throws Error(numerical_failure), cancelled, deadline_exceeded.
  SchwarzPreconditioner(const RadialKernel& kernel, std::span<const Vec3> centres, int polynomial_degree,
                        const RunContext& context);

  /// Weights (m x columns, orthogonal to the polynomials) for values (m x columns) at the centres.
  Eigen::MatrixXd apply(const Eigen::MatrixXd& values, const RunContext& context) const;

  std::size_t domains() const { return domains_.size(); }
  std::size_t bytes() const;
  /// Upper bound for m centres.
  static std::size_t bytes_for(std::size_t m);
  /// Orthogonal projection onto the complement of the polynomials.
  void project(Eigen::MatrixXd& weights) const;
  /// Orthonormal basis of the polynomials at the centres, m x q.
  const Eigen::MatrixXd& polynomials() const { return Q_; }

 private:
  struct Domain {
    std::vector<std::uint32_t> ids;  ///< its own centres first
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
  std::unique_ptr<const FastSums> to_coarse_;
};

}  // namespace deform
