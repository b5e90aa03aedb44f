// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/types.h"

namespace deform::compiled {

// A basis in less memory. Its blocks of 512 points, one after the other, are small where neighbouring points have similar values:
//   field f at point p = (1, x, y, z)(p) . affine[f] + sum over k of (offset[k] + step[k] code[k](p)) directions[f][k]
// with whole numbers as codes; x, y, z are (unit coordinates - centre) * inverse_radius. docs/compiled.md has the bytes.

inline constexpr std::size_t coded_points = 512;  ///< of a block, but the last
inline constexpr unsigned most_code_bits = 32;    ///< of a column of codes; a multiple of 4

/// One block, borrowed from wherever it is.
struct CodedBlock {
  Vec3 centre{};                           ///< unit coordinates
  double inverse_radius = 1;               ///< of unit coordinates
  std::span<const double> affine;          ///< fields x 4
  std::span<const double> steps, offsets;  ///< per column
  std::span<const std::uint8_t> bits;      ///< per column
  std::span<const float> directions;       ///< fields x stride
  std::size_t stride = 0;                  ///< at least the columns
  std::span<const std::uint8_t> codes;     ///< tile by tile, column by column
  std::span<const double> exact;           ///< the values themselves, where the above would take more; all others empty
};

/// Adds the bytes of a block.
void append_block(const CodedBlock& block, std::size_t fields, std::vector<std::byte>& bytes);

/// Fewest bytes that the blocks of so many points take.
std::size_t least_coded_bytes(std::size_t points, std::size_t fields);

/// The values of a basis, in the order of Basis::values, from the bytes of its blocks; `places` of the points in unit
/// coordinates. Throws Error(data_loss) naming the block.
std::vector<double> decoded_fields(std::span<const std::byte> bytes, std::span<const Vec3> places, std::size_t fields);

}  // namespace deform::compiled
