// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace deform::measures {

/// The least of samples as a differentiable function (G. Kreisselmeier, R. Steinhauser, Systematic control design by optimizing a
/// vector performance index, IFAC 1979): -1/rho ln sum exp(-rho t_i). With rho = ln N / tolerance it lies at most `tolerance`
/// below the least sample and never above it, however many samples there are: what it keeps above a limit is above the limit.
struct SmoothLeast {
  double value = 0;
  std::size_t least = 0;        ///< the first of the least samples
  std::vector<double> weights;  ///< N, the derivatives of the value by the samples; they add up to 1
};

/// samples: N >= 1, at least one of them finite; those that are infinite weigh nothing. tolerance > 0, in their unit.
SmoothLeast smooth_least(std::span<const double> samples, double tolerance);

}  // namespace deform::measures
