// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "core/numerics/kernels/tiles.h"

namespace deform {

/// Columns of unsigned integers for the points of one tile, each with as many bits as it needs: 0, 4, 8, ... 28 or 32. A column
/// is up to three planes, one after the other: the lowest 4 bits (8 bytes), the next 8 (16 bytes), the next 16 (32 bytes); of 32
/// bits the whole numbers.

/// Largest number of a column: one bit is left out, so that conversions to double are those of signed numbers.
inline constexpr std::uint32_t largest_code = 0x7fffffffu;

/// Fewest bits of a column for numbers up to `largest`.
unsigned code_bits(std::uint32_t largest);
/// Bytes that a column takes in a tile.
constexpr std::size_t coded_bytes(unsigned bits) { return bits * tile_size / 8; }

/// Writes coded_bytes(bits) bytes. Every value below 2^bits. Any thread.
void encode_column(const std::uint32_t* values, unsigned bits, std::uint8_t* to);
/// out[column][16] from columns that follow each other, at an address that is a multiple of 4. Any thread.
void decode_columns(const std::uint8_t* codes, std::span<const std::uint8_t> bits, double* out);

/// out[c][k] += sum over the rows r of B[r][c] * A[r][k], k below `stride`, a multiple of 4: products of float rows with columns
/// of doubles, every column summed in the order of the rows. B has row stride ldb, out `stride`. Any thread.
void add_weighted_rows(const float* A, std::size_t stride, std::span<const std::uint32_t> rows, const double* B, std::size_t ldb,
                       std::size_t columns, double* out);

}  // namespace deform
