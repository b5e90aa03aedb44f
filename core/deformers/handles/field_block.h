// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/types.h"
#include "core/deformers/handles/field_tiles.h"

namespace deform {

/// Compressed fields at a block of consecutive points. Smooth fields differ little from affine functions of the place over
/// neighbouring points, and the remainders of many fields span a space of low dimension:
///   field f at point p = (1, x, y, z)(p) . affine[f] + sum over k of (offset[k] + step[k] code[k](p)) directions[f][k]
/// where the codes are integers and the places, which are known from the mesh, need not be stored. Numerical rank: Golub and
/// Van Loan, Matrix Computations, 5.4; quantization of orthogonal coefficients: Goyal, Theoretical foundations of transform
/// coding (2001).
struct FieldBlock {
  static constexpr std::size_t tiles = 32;  ///< tiles of each block but the last
  static constexpr std::size_t points = tiles * tile_size;
  static constexpr std::size_t affine_terms = 4;

  Vec3 centre{};
  double inverse_radius = 1;       ///< local coordinates are (place - centre) * inverse_radius, at most 1
  std::vector<double> affine;      ///< fields x 4
  std::vector<double> steps;       ///< step of each column
  std::vector<double> offsets;     ///< offset of each column
  std::vector<std::uint8_t> bits;  ///< bits of each column, see coded_tiles.h
  std::size_t stride = 0;          ///< row stride of `directions`: the number of columns, rounded up to a multiple of four
  std::vector<float> directions;   ///< fields x stride
  std::size_t tile_bytes = 0;      ///< bytes of the codes of a tile, column by column
  std::vector<std::uint8_t> codes;
  /// The uncompressed fields as in FieldTiles, if compression would take more memory; the other arrays are empty then.
  std::vector<double> exact;

  std::size_t columns() const { return bits.size(); }
  /// Writes 1, x, y, z in local coordinates at up to 16 places to rows[4][16], padded with 0.
  void affine_rows(std::span<const Vec3> places, double* rows) const;
  std::size_t bytes() const;
};

/// Compresses the block of `fields` that begins at point `first`, with an error of at most `bound` in every value. `places` are
/// all points of the fields in unit coordinates. errors[f] receives the largest error of field f at the points of the block,
/// including the rounding of sums in another order. Any thread.
FieldBlock compress_block(const FieldTiles& fields, std::size_t first, std::span<const Vec3> places, double bound,
                          std::span<double> errors);

}  // namespace deform
