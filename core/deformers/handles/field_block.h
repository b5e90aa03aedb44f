// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/types.h"
#include "core/deformers/handles/field_tiles.h"

namespace deform {

/// Some consecutive points of fields in less memory. Fields that are smooth differ little from affine functions of the place
/// among neighbouring points, and what is left of many fields is spanned by few directions:
///   field f at point p = (1, x, y, z)(p) . affine[f] + sum over k of (offset[k] + step[k] code[k](p)) directions[f][k]
/// with whole numbers as codes. The places are those of the mesh and cost nothing. Numerical rank: Golub and Van Loan, Matrix
/// Computations, 5.4; the quantization of orthogonal coefficients: Goyal, Theoretical foundations of transform coding (2001).
struct FieldBlock {
  static constexpr std::size_t tiles = 32;  ///< that a block is made of, but the last
  static constexpr std::size_t points = tiles * tile_size;
  static constexpr std::size_t affine_terms = 4;

  Vec3 centre{};
  double inverse_radius = 1;       ///< local coordinates are (place - centre) * inverse_radius, at most 1
  std::vector<double> affine;      ///< fields x 4
  std::vector<double> steps;       ///< per column
  std::vector<double> offsets;     ///< per column
  std::vector<std::uint8_t> bits;  ///< per column, see coded_tiles.h
  std::size_t stride = 0;          ///< of `directions`: the columns, rounded up to a multiple of four
  std::vector<float> directions;   ///< fields x stride
  std::size_t tile_bytes = 0;      ///< of the codes of a tile, column after column
  std::vector<std::uint8_t> codes;
  std::vector<double>
      exact;  ///< the fields themselves, as FieldTiles has them, where the above would take more; all others empty

  std::size_t columns() const { return bits.size(); }
  /// 1, x, y, z in local coordinates at up to 16 places: rows[4][16], 0 behind the last.
  void affine_rows(std::span<const Vec3> places, double* rows) const;
  std::size_t bytes() const;
};

/// The block of `fields` that begins at point `first`, such that no value is off by more than `bound`; places of all points of
/// the fields, unit coordinates. errors[f] becomes the largest error of a field at the points, with what sums in another order
/// may add. A pure function.
FieldBlock compress_block(const FieldTiles& fields, std::size_t first, std::span<const Vec3> places, double bound,
                          std::span<double> errors);

}  // namespace deform
