// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cmath>

#include "core/base/run_context.h"

namespace deform {

/// How conjugate_gradients() ended.
enum class GradientsEnd {
  converged,
  limit,       ///< the limit of iterations was reached
  indefinite,  ///< the matrix is not positive definite along a direction; x is the iterate before it
};

template <typename Vectors>
struct GradientsResult {
  Vectors x;
  GradientsEnd end = GradientsEnd::converged;
  int iterations = 0;
};

/// Solves A x = b by preconditioned conjugate gradients (Hestenes, Stiefel 1952). Vectors is an Eigen vector, or a matrix that is
/// treated as one long vector. product(p) returns A p and preconditioned(r) an approximation of A^-1 r; both are symmetric. Stops
/// when the residual, in the norm of the preconditioner, is `accuracy` times that of b. Throws what the context throws.
template <typename Vectors, typename Product, typename Preconditioned>
GradientsResult<Vectors> conjugate_gradients(const Vectors& b, const Product& product, const Preconditioned& preconditioned,
                                             double accuracy, int most_iterations, const RunContext& context) {
  GradientsResult<Vectors> result{Vectors::Zero(b.rows(), b.cols())};
  Vectors residual = b, z = preconditioned(residual), p = z;
  double rz = residual.cwiseProduct(z).sum();
  const double wanted = accuracy * std::sqrt(std::abs(rz));
  for (; std::sqrt(std::abs(rz)) > wanted; ++result.iterations) {
    if (result.iterations == most_iterations) {
      result.end = GradientsEnd::limit;
      break;
    }
    context.check();
    const Vectors Ap = product(p);
    const double curvature = p.cwiseProduct(Ap).sum();
    if (!(curvature > 0)) {
      result.end = GradientsEnd::indefinite;
      break;
    }
    const double alpha = rz / curvature;
    result.x += alpha * p;
    residual -= alpha * Ap;
    z = preconditioned(residual);
    const double next = residual.cwiseProduct(z).sum();
    p = z + (next / rz) * p;
    rz = next;
  }
  return result;
}

}  // namespace deform
