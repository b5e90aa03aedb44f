// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/fast_sums/checked_sums.h"

#include <algorithm>
#include <cmath>

#include "core/numerics/fast_sums/fast_sums.h"
#include "core/numerics/kernels/tiles.h"

namespace deform {

namespace {

constexpr std::size_t most_samples = 512;
constexpr int last_order = 16;
constexpr double digits_per_order = 0.75;  // at least, where kernels are smooth
constexpr double rounding = 1e-15;         // of the sum of absolute values
constexpr double most_direct = 1e10;       // pairs: some seconds

double largest_magnitude(std::span<const double> values) {
  double largest = 0;
  for (const double v : values) largest = std::max(largest, std::abs(v));
  return largest;
}

}  // namespace

std::vector<double> checked_sums(const RadialKernel& kernel, std::span<const Vec3> points, std::span<const Vec3> centres,
                                 std::span<const double> weights, std::size_t columns, const SumAccuracy& accuracy,
                                 const RunContext& context) {
  const std::size_t count = std::min(most_samples, points.size());
  std::vector<Vec3> places;
  for (std::size_t s = 0; s < count; ++s) places.push_back(points[s * points.size() / count]);
  const std::vector<double> exact = kernel_sums(kernel, places, centres, weights, columns, context);
  std::vector<double> absolute(weights.begin(), weights.end());
  for (double& w : absolute) w = std::abs(w);
  const double scale = largest_magnitude(kernel_sums(kernel, places, centres, absolute, columns, context));
  const double allowed = std::max({accuracy.absolute, accuracy.relative * largest_magnitude(exact), rounding * scale});
  int order = accuracy.order;
  while (true) {
    std::vector<double> sums = FastSums(kernel, points, centres, {order, 0}).sums(weights, columns, context);
    double error = 0;
    for (std::size_t s = 0; s < count; ++s) {
      const double* at = sums.data() + s * points.size() / count * columns;
      for (std::size_t c = 0; c < columns; ++c) error = std::max(error, 2 * std::abs(at[c] - exact[s * columns + c]));
    }
    if (error <= allowed) return sums;
    if (order >= last_order) {
      const bool affordable = static_cast<double>(points.size()) * static_cast<double>(centres.size()) <= most_direct;
      return affordable ? kernel_sums(kernel, points, centres, weights, columns, context) : sums;
    }
    const double missing = std::min(10.0, std::log10(error / allowed));
    const int steps = std::max(1, static_cast<int>(std::ceil(missing / (2 * digits_per_order))));
    order = std::min(order + 2 * steps, last_order);
  }
}

}  // namespace deform
