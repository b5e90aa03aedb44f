// SPDX-License-Identifier: Apache-2.0
#include "core/measures/smooth_least.h"

#include <algorithm>
#include <cmath>

namespace deform::measures {

SmoothLeast smooth_least(std::span<const double> samples, double tolerance) {
  SmoothLeast found;
  found.least = static_cast<std::size_t>(std::min_element(samples.begin(), samples.end()) - samples.begin());
  const double least = samples[found.least];
  const double rho = std::log(static_cast<double>(std::max<std::size_t>(samples.size(), 2))) / tolerance;
  found.weights.resize(samples.size());
  double sum = 0;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    found.weights[i] = std::exp(-rho * (samples[i] - least));
    sum += found.weights[i];
  }
  for (double& weight : found.weights) weight /= sum;
  found.value = least - std::log(sum) / rho;
  return found;
}

}  // namespace deform::measures
