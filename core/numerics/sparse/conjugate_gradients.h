// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cmath>

#include "core/base/run_context.h"

namespace deform {

/// How conjugate_gradients() ended.
enum class GradientsEnd {
  converged,
  limit,       ///< after the most iterations allowed
  indefinite,  ///< the matrix is not positive definite along a direction: x is what there was before it
};

template <typename Vectors>
struct GradientsResult {
  Vectors x;
  GradientsEnd end = GradientsEnd::converged;
  int iterations = 0;
};

/// A x = b by preconditioned conjugate gradients (Hestenes, Stiefel 1952). Vectors is any Eigen matrix, a vector of its own as a
/// whole; product(p) is A p, preconditioned(r) about A^-1 r, both symmetric. Until the residual in the norm of the preconditioner
/// is `accuracy` times that of b. Throws what the context throws.
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
