// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/handle_basis.h"

#include <algorithm>

#include "core/base/parallel.h"
#include "core/deformers/option_checks.h"

namespace deform {

void HandleBasis::compress(std::span<const Vec3> places, double tolerance, const RunContext& context) {
  const std::size_t fields = tiles.fields();
  compressed.emplace(tiles, places, tolerance / static_cast<double>(fields), context);
  tiles = FieldTiles(0, fields);
}

std::size_t HandleBasis::bytes() const {
  return (compressed ? compressed->bytes() : tiles.bytes()) + residuals.size() * sizeof(double);
}

std::size_t HandleBasis::bytes_for(std::size_t points, std::size_t fields, double tolerance) {
  const double bound = tolerance / static_cast<double>(fields);
  return (tolerance > 0 ? CompressedFields::bytes_for(points, fields, bound) : FieldTiles::bytes_for(points, fields)) +
         fields * sizeof(double);
}

std::size_t HandleBasis::peak_bytes_for(std::size_t points, std::size_t fields, double tolerance) {
  const std::size_t bytes = bytes_for(points, fields, tolerance);
  if (tolerance == 0) return bytes;
  constexpr std::size_t matrices = 10;  // of a block, in each thread
  const std::size_t block = FieldBlock::points * (fields + 4) * sizeof(double);
  return bytes + bytes_for(points, fields, 0) + points * sizeof(Vec3) +
         static_cast<std::size_t>(thread_count({})) * matrices * block;
}

void check_basis_tolerance(Problems& problems, double tolerance, const std::string& field) {
  if (tolerance != 0) check_option_range(problems, tolerance, least_basis_tolerance, largest_basis_tolerance, field);
}

bool wants_basis(BasisMode mode, std::size_t basis_bytes, std::size_t factor_bytes) {
  constexpr std::size_t always_fits = std::size_t{1} << 30;
  if (mode != BasisMode::automatic) return mode == BasisMode::always;
  return basis_bytes <= std::max(4 * factor_bytes, always_fits);
}

}  // namespace deform
