// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/field_tiles.h"

#include "core/base/parallel.h"

namespace deform {

namespace {

constexpr std::size_t field_tiles_per_task = 64;

}  // namespace

std::vector<double> FieldTiles::transposed_product(std::span<const Vec3> X, const RunContext& context) const {
  const std::size_t tiles = tile_count(points_);
  const std::size_t tasks = (tiles + field_tiles_per_task - 1) / field_tiles_per_task;
  std::vector<std::vector<double>> partial(tasks, std::vector<double>(fields_ * 3, 0.0));
  parallel_for(context, tiles, field_tiles_per_task, [&](std::size_t begin, std::size_t end) {
    std::vector<double>& sums = partial[begin / field_tiles_per_task];
    double columns[3 * tile_size];
    for (std::size_t t = begin; t < end; ++t) {
      for (std::size_t i = 0; i < tile_size; ++i) {
        const std::size_t at = t * tile_size + i;
        for (std::size_t k = 0; k < 3; ++k) columns[k * tile_size + i] = at < points_ ? X[at][k] : 0.0;
      }
      tile_product_transposed(tile(t), fields_, columns, 3, sums.data(), 3);
    }
  });
  std::vector<double> result(fields_ * 3, 0.0);
  for (const auto& sums : partial) {
    for (std::size_t k = 0; k < result.size(); ++k) result[k] += sums[k];
  }
  return result;
}

}  // namespace deform
