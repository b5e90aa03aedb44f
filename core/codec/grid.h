// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "core/base/types.h"

namespace deform::codec {

/// Displacements of a block on an integer grid: point i is registered[i] + (values[3 i + k] + offset[k]) * step. The offset is
/// the first point's, so that the values are small and the first one is zero.
struct Grid {
  double step = 0;                         ///< model units
  std::array<std::int64_t, 3> offset{};    ///< added to the values, in steps
  std::unique_ptr<std::int32_t[]> buffer;  ///< not initialized before it is filled: that costs as much as filling it
  std::size_t size = 0;                    ///< 3 x count
  double max_error = 0;                    ///< true largest |reconstructed - deformed|, model units

  /// count x 3, row by row, |value| <= largest_value
  std::span<const std::int32_t> values() const { return {buffer.get(), size}; }
};

/// Largest magnitude of a value of a grid.
inline constexpr std::int32_t largest_value = 1 << 29;

/// Fills `grid`; false when the block has no such representation within the tolerance: coordinates that are not finite, a range
/// of more than 2^29 steps, or a tolerance near the rounding error of the coordinates.
bool to_grid(std::span<const Vec3> registered, std::span<const Vec3> deformed, double tolerance, Grid& grid);

/// The inverse, with the very floating-point expression that to_grid() measured.
void from_grid(std::span<const Vec3> registered, std::span<const std::int32_t> values, const Grid& grid, std::span<Vec3> out);

/// What a decoder accepts of step and offset: then every reconstruction is exact up to its two roundings.
bool plausible(double step, const std::array<std::int64_t, 3>& offset);

}  // namespace deform::codec
