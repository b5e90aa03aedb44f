// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/kernels/kernel.h"

namespace deform {

/// What kernel sums may be wrong by.
struct SumAccuracy {
  int order = 8;        ///< of FastSums to begin with, 4..16
  double absolute = 0;  ///< in the units of the sums
  double relative = 0;  ///< of the largest sum; the larger of the two counts
};

/// Sums and what they are wrong by: twice the largest error seen; 0 when nothing was left out.
struct CheckedSums {
  std::vector<double> sums;
  double error = 0;
};

/// FastSums (n x columns, row by row) whose error is measured where they are wanted: at up to 512 of the points,
/// against direct sums. The order is raised until twice the largest error seen is allowed, or is that of the arithmetic; what the
/// last order misses is summed directly as long as that is affordable. The order that serves at the centres says nothing here:
/// trees of other points meet on other levels. Not for Wendland's kernel. Deterministic; any thread. Throws Error(cancelled),
/// deadline_exceeded.
CheckedSums checked_sums(const RadialKernel& kernel, std::span<const Vec3> points, std::span<const Vec3> centres,
                         std::span<const double> weights, std::size_t columns, const SumAccuracy& accuracy,
                         const RunContext& context);

}  // namespace deform
