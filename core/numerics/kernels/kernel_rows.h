// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/kernels/kernel.h"
#include "core/numerics/sparse/sparse.h"

namespace deform {

/// Radial functions around centres as the functions of a subspace (thesis 8.3.1, 8.3.2): n x k, entry (i, j) is
/// kernel(|points[i] - centres[j]|), 0 from `reach` on; infinite: a full matrix. In parallel.
SparseRows kernel_rows(const RadialKernel& kernel, double reach, std::span<const Vec3> centres, std::span<const Vec3> points,
                       const RunContext& context = {});

/// The same without a reach, as a full column-major matrix.
Eigen::MatrixXd full_kernel_rows(const RadialKernel& kernel, std::span<const Vec3> centres, std::span<const Vec3> points,
                                 const RunContext& context = {});

}  // namespace deform
