// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "core/base/large_array.h"
#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/kernels/tiles.h"

namespace deform {

/// The values of fields at points, stored in tiles of 16 points and field by field within a tile, so that evaluating a design (a
/// sum of the fields) is one sequential pass through memory, and a population is a matrix product.
class FieldTiles {
 public:
  FieldTiles(std::size_t points, std::size_t fields)
      : points_(points), fields_(fields), values_(tile_count(points) * tile_size * fields) {}

  std::size_t points() const { return points_; }
  std::size_t fields() const { return fields_; }
  std::size_t bytes() const { return values_.size() * sizeof(double); }
  static std::size_t bytes_for(std::size_t points, std::size_t fields) {
    return tile_count(points) * tile_size * fields * sizeof(double);
  }

  const double* tile(std::size_t t) const { return values_.data() + t * fields_ * tile_size; }
  double* tile(std::size_t t) { return values_.data() + t * fields_ * tile_size; }
  double at(std::size_t point, std::size_t field) const { return tile(point / tile_size)[field * tile_size + point % tile_size]; }
  double& at(std::size_t point, std::size_t field) { return tile(point / tile_size)[field * tile_size + point % tile_size]; }

  /// The transposed fields times X (points x 3): fields x 3, row-major. The order of summation is fixed. Any thread.
  std::vector<double> transposed_product(std::span<const Vec3> X, const RunContext& context) const;

 private:
  std::size_t points_, fields_;
  LargeArray<double> values_;
};

}  // namespace deform
