// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/kernels/kernel.h"
#include "core/numerics/sparse/sparse.h"

namespace deform {

/// The values of radial functions that span a subspace (thesis 8.3.1, 8.3.2): n x k, entry (i, j) is kernel(|points[i] -
/// centres[j]|) for distances below `reach`, else 0. An infinite reach gives a full matrix. Runs in parallel.
SparseRows kernel_rows(const RadialKernel& kernel, double reach, std::span<const Vec3> centres, std::span<const Vec3> points,
                       const RunContext& context = {});

/// The same for an infinite reach, as a dense column-major matrix.
Eigen::MatrixXd full_kernel_rows(const RadialKernel& kernel, std::span<const Vec3> centres, std::span<const Vec3> points,
                                 const RunContext& context = {});

}  // namespace deform
