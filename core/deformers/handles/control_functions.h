// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/base/types.h"
#include "core/base/vectors.h"
#include "core/numerics/kernels/tiles.h"
#include "core/numerics/sparse/function_rows.h"

namespace deform {

/// Functions of control points (columns) at points (rows). Immutable; any thread.
class ControlFunctions : public ComputedRows {
 public:
  /// out[i * vectors.size() + d] = sum over the entries of rows[i] of value times vectors[d][column], where vectors[d] holds one
  /// vector for each control point. The sums do not depend on each other, bit for bit.
  virtual void sums(std::span<const PointId> rows, std::span<const Vec3* const> vectors, Vec3* out) const {
    for (std::size_t i = 0; i < rows.size(); ++i, out += vectors.size()) {
      for (std::size_t d = 0; d < vectors.size(); ++d) out[d] = {};
      for_each(rows[i], [&](std::int64_t column, double value) {
        for (std::size_t d = 0; d < vectors.size(); ++d) out[d] = out[d] + value * vectors[d][column];
      });
    }
  }
  /// The same sums of at most tile_size rows, as tiles have them: out[(3 d + c) * tile_size + i] is component c of the sum with
  /// vectors[d] in rows[i]. What belongs to no row is left as it is.
  virtual void tile_sums(std::span<const PointId> rows, std::span<const Vec3* const> vectors, double* out) const {
    std::vector<Vec3> found(rows.size() * vectors.size());
    sums(rows, vectors, found.data());
    for (std::size_t i = 0; i < rows.size(); ++i) {
      for (std::size_t d = 0; d < vectors.size(); ++d) {
        for (std::size_t c = 0; c < 3; ++c) out[(3 * d + c) * tile_size + i] = found[i * vectors.size() + d][c];
      }
    }
  }
};

}  // namespace deform
