// SPDX-License-Identifier: Apache-2.0
#include "core/codec/grid.h"

#include <algorithm>
#include <cmath>

namespace deform::codec {

namespace {

// Loops below run over coordinates with the axis as index modulo 3, in groups of 12 so that the compiler keeps the accumulators
// in vector registers without being allowed to reorder floating-point sums.
constexpr std::size_t lanes = 12;
constexpr std::int64_t largest_offset = std::int64_t{1} << 51;

struct Extent {
  double largest = 0;  // |coordinate|
  bool finite = true;
};

Extent extent(const double* values, std::size_t count) {
  double largest[lanes] = {};
  double poison[lanes] = {};  // stays 0 for finite values, becomes NaN otherwise
  const auto visit = [&](std::size_t i, std::size_t lane) {
    const double magnitude = std::fabs(values[i]);
    largest[lane] = magnitude > largest[lane] ? magnitude : largest[lane];
    poison[lane] += values[i] - values[i];
  };
  std::size_t i = 0;
  for (; i + lanes <= count; i += lanes) {
    for (std::size_t lane = 0; lane < lanes; ++lane) visit(i + lane, lane);
  }
  for (; i < count; ++i) visit(i, 0);
  Extent result;
  for (std::size_t lane = 0; lane < lanes; ++lane) {
    result.largest = std::max(result.largest, largest[lane]);
    result.finite = result.finite && poison[lane] == 0;
  }
  return result;
}

// Adding and subtracting 1.5 * 2^52 rounds to the nearest integer, as long as the magnitude is below 2^51.
constexpr double rounder = 6755399441055744.0;
double rounded(double x) { return (x + rounder) - rounder; }

}  // namespace

bool plausible(double step, const std::array<std::int64_t, 3>& offset) {
  return std::isnormal(step) && step > 0 &&
         std::all_of(offset.begin(), offset.end(), [](std::int64_t o) { return o >= -largest_offset && o <= largest_offset; });
}

bool to_grid(std::span<const Vec3> registered, std::span<const Vec3> deformed, double tolerance, Grid& grid) {
  grid = Grid{};
  const std::size_t count = 3 * registered.size();
  const double* rest = registered.empty() ? nullptr : registered[0].data();
  const double* target = deformed.empty() ? nullptr : deformed[0].data();
  const Extent a = extent(rest, count);
  const Extent b = extent(target, count);
  if (!a.finite || !b.finite) return false;
  const double largest = std::max(a.largest, b.largest);

  // Half a step plus the roundings of difference, product and sum must stay below the tolerance.
  const double slack = 16 * 0x1p-53 * largest;
  grid.step = 2 * (tolerance - slack);
  if (!(tolerance > 2 * slack) || !std::isnormal(grid.step)) return false;
  const double inverse = 1 / grid.step;
  if (!std::isfinite(inverse) || !(2 * largest * inverse < 0x1p50)) return false;
  if (count == 0) return true;

  double start[lanes];
  for (std::size_t lane = 0; lane < lanes; ++lane) {
    start[lane] = rounded((target[lane % 3] - rest[lane % 3]) * inverse);
  }
  grid.buffer = std::make_unique_for_overwrite<std::int32_t[]>(count);
  grid.size = count;
  std::int32_t* values = grid.buffer.get();
  double range[lanes] = {};
  double error[lanes] = {};
  const double step = grid.step;
  const auto visit = [&](std::size_t i, std::size_t lane) {
    const double q = rounded((target[i] - rest[i]) * inverse);
    const double distance = q - start[lane];
    const double magnitude = std::fabs(distance);
    range[lane] = magnitude > range[lane] ? magnitude : range[lane];
    const double difference = std::fabs((rest[i] + q * step) - target[i]);
    error[lane] = difference > error[lane] ? difference : error[lane];
    const double low = distance > -0x1p30 ? distance : -0x1p30;  // keeps the conversion defined; refused below
    values[i] = static_cast<std::int32_t>(low < 0x1p30 ? low : 0x1p30);
  };
  std::size_t i = 0;
  for (; i + lanes <= count; i += lanes) {
    for (std::size_t lane = 0; lane < lanes; ++lane) visit(i + lane, lane);
  }
  for (; i < count; ++i) visit(i, i % 3);
  if (*std::max_element(range, range + lanes) > largest_value) return false;
  grid.max_error = *std::max_element(error, error + lanes);
  for (int k = 0; k < 3; ++k) grid.offset[k] = static_cast<std::int64_t>(start[k]);
  return grid.max_error <= tolerance;
}

void from_grid(std::span<const Vec3> registered, std::span<const std::int32_t> values, const Grid& grid, std::span<Vec3> out) {
  double offset[lanes];
  for (std::size_t lane = 0; lane < lanes; ++lane) offset[lane] = static_cast<double>(grid.offset[lane % 3]);
  const std::size_t count = values.size();
  if (count == 0) return;
  const double* rest = registered[0].data();
  double* result = out[0].data();
  std::size_t i = 0;
  for (; i + lanes <= count; i += lanes) {
    for (std::size_t lane = 0; lane < lanes; ++lane) {
      result[i + lane] = rest[i + lane] + (values[i + lane] + offset[lane]) * grid.step;
    }
  }
  for (; i < count; ++i) result[i] = rest[i] + (values[i] + offset[i % 3]) * grid.step;
}

}  // namespace deform::codec
