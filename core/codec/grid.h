// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "core/base/types.h"

namespace deform::codec {

/// The displacements of a block, quantized to an integer grid: coordinate k of point i is registered[i][k] + (values[3 i + k] +
/// offset[k]) * step. The offset is that of the first point, so that values are small and the first triple is zero.
struct Grid {
  double step = 0;                         ///< model units
  std::array<std::int64_t, 3> offset{};    ///< added to the values, in steps
  std::unique_ptr<std::int32_t[]> buffer;  ///< 3 x count; not initialized before it is filled, to save time
  std::size_t size = 0;                    ///< 3 x count
  double max_error = 0;                    ///< true largest |reconstructed - deformed|, model units

  /// count x 3, row by row, |value| <= largest_value
  std::span<const std::int32_t> values() const { return {buffer.get(), size}; }
};

/// Largest magnitude of a value of a grid.
inline constexpr std::int32_t largest_value = 1 << 29;

/// Quantizes a block with the given tolerance per coordinate, in model units. Returns false if that is impossible: coordinates
/// that are not finite, a range of more than 2^29 steps, or a tolerance near the rounding error of the coordinates.
bool to_grid(std::span<const Vec3> registered, std::span<const Vec3> deformed, double tolerance, Grid& grid);

/// The inverse of to_grid(). It evaluates the same floating-point expression, so that Grid::max_error holds exactly.
void from_grid(std::span<const Vec3> registered, std::span<const std::int32_t> values, const Grid& grid, std::span<Vec3> out);

/// Whether a decoder accepts this step and offset. If so, every reconstruction is exact up to its two roundings.
bool plausible(double step, const std::array<std::int64_t, 3>& offset);

}  // namespace deform::codec
