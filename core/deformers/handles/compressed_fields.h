// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/deformers/handles/field_block.h"
#include "core/deformers/handles/field_tiles.h"

namespace deform {

/// What FieldTiles holds, to a bound that is kept at every point, in a fraction of the memory. Places are those of the points, in
/// unit coordinates, and always the same ones.
class CompressedFields {
 public:
  /// No stored value is off by more than `bound`, over 0. Progress "basis", without fractions.
  CompressedFields(const FieldTiles& fields, std::span<const Vec3> places, double bound, const RunContext& context);

  std::size_t points() const { return points_; }
  std::size_t fields() const { return fields_; }
  /// Per field: what a stored value is off by at most, with the rounding of sums of them; measured at all points.
  const std::vector<double>& errors() const { return errors_; }
  /// Of FieldBlock::points points each, but the last.
  const std::vector<FieldBlock>& blocks() const { return blocks_; }
  std::size_t bytes() const;
  /// About the most that fields of size 1 take, at most what FieldTiles takes.
  static std::size_t bytes_for(std::size_t points, std::size_t fields, double bound);

  /// As FieldTiles::transposed_product(), of the stored values.
  std::vector<double> transposed_product(std::span<const Vec3> X, std::span<const Vec3> places, const RunContext& context) const;

 private:
  friend class CompressedSums;

  std::size_t points_, fields_;
  std::vector<FieldBlock> blocks_;
  std::vector<double> errors_;
};

/// Sums of compressed fields at tiles of points. What a block needs is worked out once for tiles in order. For one thread.
class CompressedSums {
 public:
  /// Columns of coefficients: fields x columns with row stride ldb, of which only the named rows count. Borrows all of them.
  CompressedSums(const CompressedFields& fields, std::span<const std::uint32_t> rows, const double* B, std::size_t ldb,
                 std::size_t columns)
      : fields_(fields), rows_(rows), B_(B), ldb_(ldb), columns_(columns) {}

  /// out[c][16] += the sums of the columns [first, first + count) at the points of a tile, of which `places` has up to 16. Every
  /// column has the same bits however many there are.
  void add_tile(std::size_t tile, std::span<const Vec3> places, std::size_t first, std::size_t count, double* out);

 private:
  void enter(std::size_t block);

  const CompressedFields& fields_;
  const std::span<const std::uint32_t> rows_;
  const double* const B_;
  const std::size_t ldb_, columns_;
  std::size_t block_ = static_cast<std::size_t>(-1);  ///< entered
  std::vector<double> coefficients_;                  ///< (4 + columns of the block) x columns_
  std::vector<double> along_;                         ///< columns_ x stride of the block
  std::vector<double> values_;                        ///< (4 + columns of the block) x 16
};

}  // namespace deform
