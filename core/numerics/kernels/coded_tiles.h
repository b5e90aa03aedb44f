// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "core/numerics/kernels/tiles.h"

namespace deform {

/// Columns of unsigned integers for the points of one tile, each stored with as many bits as it needs: 0, 4, 8, ... 28 or 32. Up
/// to 28 bits, a column consists of up to three consecutive planes: the lowest 4 bits (8 bytes), the next 8 (16 bytes), the next
/// 16 (32 bytes). With 32 bits it consists of whole integers.

/// Largest value of a column: 31 bits, so that the faster conversion of signed integers to double applies.
inline constexpr std::uint32_t largest_code = 0x7fffffffu;

/// The smallest number of bits for values up to `largest`.
unsigned code_bits(std::uint32_t largest);
/// Bytes of a column in one tile.
constexpr std::size_t coded_bytes(unsigned bits) { return bits * tile_size / 8; }

/// Encodes 16 values below 2^bits and writes coded_bytes(bits) bytes. Any thread.
void encode_column(const std::uint32_t* values, unsigned bits, std::uint8_t* to);
/// Decodes consecutive columns to out[column][16]. `codes` must be aligned to 4 bytes. Any thread.
void decode_columns(const std::uint8_t* codes, std::span<const std::uint8_t> bits, double* out);

/// out[c][16] += sum over the columns k of the numbers[k][16] * B[k][c], with k ascending, for three c; B has row stride ldb: the
/// sums of tile_product() of the decoded columns, bit for bit. `codes` must be aligned to 4 bytes. Any thread.
void add_coded_products(const std::uint8_t* codes, std::span<const std::uint8_t> bits, const double* B, std::size_t ldb,
                        double* out);

/// Prefetches one of so many equal parts of an array. Any thread.
void prefetch_share(std::span<const std::byte> array, std::size_t part, std::size_t parts);

/// out[c][k] += sum over the rows r of B[r][c] * A[r][k], for k below `stride`, a multiple of 4: products of float rows
/// with columns of doubles, each column summed in the order of the rows. B has row stride ldb, `out` has row stride
/// `stride`. Any thread.
void add_weighted_rows(const float* A, std::size_t stride, std::span<const std::uint32_t> rows, const double* B, std::size_t ldb,
                       std::size_t columns, double* out);

}  // namespace deform
