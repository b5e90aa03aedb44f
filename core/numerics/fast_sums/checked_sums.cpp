// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/fast_sums/checked_sums.h"

#include <algorithm>
#include <cmath>

#include "core/numerics/fast_sums/fast_sums.h"
#include "core/numerics/kernels/tiles.h"
#include "core/numerics/sampling/stratified.h"

namespace deform {

namespace {

constexpr std::size_t most_samples = 512;
constexpr int last_order = 16;
constexpr double digits_per_order = 0.75;  // at least, where kernels are smooth
constexpr double rounding = 2e-16;         // of the sum of absolute values
constexpr double most_direct = 1e10;       // pairs: some seconds

double largest_magnitude(std::span<const double> values) {
  double largest = 0;
  for (const double v : values) largest = std::max(largest, std::abs(v));
  return largest;
}

}  // namespace

CheckedSums checked_sums(const RadialKernel& kernel, std::span<const Vec3> points, std::span<const Vec3> centres,
                         std::span<const double> weights, std::size_t columns, const SumAccuracy& accuracy,
                         const RunContext& context) {
  const std::vector<std::size_t> samples = stratified_numbers(points.size(), most_samples);
  std::vector<Vec3> places;
  for (const std::size_t s : samples) places.push_back(points[s]);
  const std::vector<double> exact = kernel_sums(kernel, places, centres, weights, columns, context);
  std::vector<double> absolute(weights.begin(), weights.end());
  for (double& w : absolute) w = std::abs(w);
  const double scale = largest_magnitude(kernel_sums(kernel, places, centres, absolute, columns, context));
  const double allowed = std::max({accuracy.absolute, accuracy.relative * largest_magnitude(exact), rounding * scale});
  int order = accuracy.order;
  while (true) {
    std::vector<double> sums = FastSums(kernel, points, centres, {order, 0}).sums(weights, columns, context);
    double error = 0;
    for (std::size_t s = 0; s < samples.size(); ++s) {
      const double* at = sums.data() + samples[s] * columns;
      for (std::size_t c = 0; c < columns; ++c) error = std::max(error, 2 * std::abs(at[c] - exact[s * columns + c]));
    }
    if (error <= allowed) return {std::move(sums), error};
    if (order >= last_order) {
      const bool affordable = static_cast<double>(points.size()) * static_cast<double>(centres.size()) <= most_direct;
      if (affordable) return {kernel_sums(kernel, points, centres, weights, columns, context), 0};
      return {std::move(sums), error};
    }
    const double missing = std::min(10.0, std::log10(error / allowed));
    const int steps = std::max(1, static_cast<int>(std::ceil(missing / (2 * digits_per_order))));
    order = std::min(order + 2 * steps, last_order);
  }
}

}  // namespace deform
