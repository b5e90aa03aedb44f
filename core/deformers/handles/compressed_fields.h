// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/deformers/handles/field_block.h"
#include "core/deformers/handles/field_tiles.h"

namespace deform {

/// The fields of FieldTiles in a fraction of the memory, with an error bound that holds at every point. Places are the points in
/// unit coordinates; all calls must pass the same ones.
class CompressedFields {
 public:
  /// Compresses the fields with an error of at most `bound` > 0 in every value. Reports "basis" progress without fractions.
  CompressedFields(const FieldTiles& fields, std::span<const Vec3> places, double bound, const RunContext& context);

  /// Takes the parts as they are; see fits().
  CompressedFields(std::size_t points, std::size_t fields, std::vector<FieldBlock> blocks, std::vector<double> errors)
      : points_(points), fields_(fields), blocks_(std::move(blocks)), errors_(std::move(errors)) {}

  /// Whether there are so many points and fields, and the sizes of all arrays are those.
  bool fits(std::size_t points, std::size_t fields) const;

  std::size_t points() const { return points_; }
  std::size_t fields() const { return fields_; }
  /// The largest error of each field, measured at all points, including the rounding of sums.
  const std::vector<double>& errors() const { return errors_; }
  /// Blocks of FieldBlock::points points each, but the last.
  const std::vector<FieldBlock>& blocks() const { return blocks_; }
  std::size_t bytes() const;
  /// An approximate upper bound of the memory of fields of magnitude 1, at most that of FieldTiles.
  static std::size_t bytes_for(std::size_t points, std::size_t fields, double bound);

  /// As FieldTiles::transposed_product(), for the compressed values.
  std::vector<double> transposed_product(std::span<const Vec3> X, std::span<const Vec3> places, const RunContext& context) const;

 private:
  friend class CompressedSums;

  std::size_t points_, fields_;
  std::vector<FieldBlock> blocks_;
  std::vector<double> errors_;
};

/// Sums of compressed fields at tiles of points. Tiles should be visited in order, because the preparation of a block is kept for
/// the next tile. Not thread-safe.
class CompressedSums {
 public:
  /// B holds the coefficients, fields x columns with row stride ldb, of which only the given rows are used. All arguments must
  /// outlive this object.
  CompressedSums(const CompressedFields& fields, std::span<const std::uint32_t> rows, const double* B, std::size_t ldb,
                 std::size_t columns)
      : fields_(fields), rows_(rows), B_(B), ldb_(ldb), columns_(columns) {}

  /// Adds the sums of the columns [first, first + count) at the points of a tile to out[c][16]. `places` are the up to 16 points
  /// of the tile. The result of a column does not depend on the other columns, bit for bit.
  void add_tile(std::size_t tile, std::span<const Vec3> places, std::size_t first, std::size_t count, double* out);

 private:
  void enter(std::size_t block);
  /// Prefetches a share of what enter() will read of the next block, at a tile of the current one.
  void ask_for_next(std::size_t tile) const;

  const CompressedFields& fields_;
  const std::span<const std::uint32_t> rows_;
  const double* const B_;
  const std::size_t ldb_, columns_;
  std::size_t block_ = static_cast<std::size_t>(-1);  ///< the current block
  std::vector<double> coefficients_;                  ///< (4 + columns of the block) x columns_
  std::vector<double> along_;                         ///< columns_ x stride of the block
  std::vector<double> values_;                        ///< (4 + columns of the block) x 16
};

}  // namespace deform
