// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/kernels/kernel.h"

namespace deform {

/// The error allowed in kernel sums: the larger of `absolute` and `relative`.
struct SumAccuracy {
  int order = 8;        ///< initial order of FastSums, 4..16
  double absolute = 0;  ///< in the units of the sums
  double relative = 0;  ///< as a fraction of the largest sum
};

/// Kernel sums and an estimate of their error: twice the largest measured error, or 0 if all sums are direct.
struct CheckedSums {
  std::vector<double> sums;
  double error = 0;
};

/// Computes kernel sums (n x columns, row-major) by FastSums and measures their error against direct sums at up to 512 of the
/// points. The order is raised until twice the largest measured error is within `accuracy` or at the level of rounding; if the
/// highest order is not enough, sums are direct as far as that is affordable. The order that suffices at the centres need not
/// suffice here, because trees of other points interact on other levels. Not for Wendland's kernel. Deterministic; any thread.
/// Throws Error(cancelled), deadline_exceeded.
CheckedSums checked_sums(const RadialKernel& kernel, std::span<const Vec3> points, std::span<const Vec3> centres,
                         std::span<const double> weights, std::size_t columns, const SumAccuracy& accuracy,
                         const RunContext& context);

}  // namespace deform
