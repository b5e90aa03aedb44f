// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/kernels/kernel.h"

namespace deform {

/// Points per tile, the unit of all vectorized loops. It is a multiple of every vector length, so that the arithmetic for a point
/// does not depend on its position in the tile.
inline constexpr std::size_t tile_size = 16;

constexpr std::size_t tile_count(std::size_t points) { return (points + tile_size - 1) / tile_size; }

/// Points in tiles of 16 x, 16 y and 16 z. The last tile is padded with its last point.
class TiledPoints {
 public:
  TiledPoints() = default;
  explicit TiledPoints(std::span<const Vec3> points);
  std::size_t count() const { return count_; }
  std::size_t tiles() const { return tile_count(count_); }
  const double* tile(std::size_t t) const { return xyz_.data() + t * 3 * tile_size; }
  std::size_t bytes() const { return xyz_.size() * sizeof(double); }

 private:
  std::size_t count_ = 0;
  std::vector<double> xyz_;
};

/// out[c][16] += sum over k of A[k][16] * B[k][c], with k ascending: one tile of points times a K x columns matrix B with
/// row stride ldb. The order of the sum is the same for every column, so results do not depend on how columns are grouped.
/// Any thread.
void tile_product(const double* A, std::size_t K, const double* B, std::size_t ldb, std::size_t columns, double* out);
/// The same sum over the given rows of A and B only, which ascend; the others are not read. For tiles that are taken one after
/// the other from memory: prefetches these rows of the tiles that follow A there. Any thread.
void tile_product(const double* A, std::size_t K, std::span<const std::uint32_t> rows, const double* B, std::size_t ldb,
                  std::size_t columns, double* out);

/// out[i] = keep * places[i] + (values[i], values[16 + i], values[32 + i]) for the 16 points of a tile. With `keep` 0 or 1 it is
/// the same whether or not products are fused with sums. Any thread.
void tile_positions(const Vec3* places, double keep, const double* values, Vec3* out);

/// out[k][c] += sum over the 16 points of A[k][16] * X[c][16]: the transposed product. out is K x columns with row stride ldo.
/// May be called from any thread.
void tile_product_transposed(const double* A, std::size_t K, const double* X, std::size_t columns, double* out, std::size_t ldo);

/// out[j][16] = phi(|point - centre j|) for the points of one tile and all centres. Here and below, kernels with a parity include
/// their images. Any thread.
void tile_kernel(const RadialKernel& kernel, const double* tile, std::span<const Vec3> centres, double* out);

/// out[c][16] += sum over centres j of phi(|point - centre j|) * weights[j][c]: kernel sums of one tile. `weights` is m x columns
/// with row stride ldw. Bitwise independent of the grouping of columns. Any thread.
void tile_kernel_sums(const RadialKernel& kernel, const double* tile, std::span<const Vec3> centres, const double* weights,
                      std::size_t ldw, std::size_t columns, double* out);

/// Kernel sums for all points, in parallel: n x columns, row-major. `weights` is m x columns, row-major.
std::vector<double> kernel_sums(const RadialKernel& kernel, std::span<const Vec3> points, std::span<const Vec3> centres,
                                std::span<const double> weights, std::size_t columns, const RunContext& context);

/// The name of the instruction set that the vectorized loops use on this machine.
const char* vector_target();

}  // namespace deform
