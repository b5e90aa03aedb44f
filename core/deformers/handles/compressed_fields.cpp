// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/compressed_fields.h"

#include <algorithm>
#include <cmath>

#include "core/base/parallel.h"
#include "core/numerics/kernels/coded_tiles.h"

namespace deform {

namespace {

constexpr std::size_t blocks_per_task = 2;
constexpr std::size_t affine_terms = FieldBlock::affine_terms;

std::size_t block_count(std::size_t points) { return (points + FieldBlock::points - 1) / FieldBlock::points; }

/// Rows of a block at a tile: 1, x, y, z, and the codes.
void fill_rows(const FieldBlock& block, std::size_t tile, std::span<const Vec3> places, std::vector<double>& rows) {
  rows.resize((affine_terms + block.columns()) * tile_size);
  block.affine_rows(places, rows.data());
  decode_columns(block.codes.data() + tile * block.tile_bytes, block.bits, rows.data() + affine_terms * tile_size);
}

}  // namespace

CompressedFields::CompressedFields(const FieldTiles& fields, std::span<const Vec3> places, double bound,
                                   const RunContext& context)
    : points_(fields.points()), fields_(fields.fields()), blocks_(block_count(fields.points())), errors_(fields.fields(), 0.0) {
  std::vector<double> errors(blocks_.size() * fields_);
  parallel_for(context, blocks_.size(), 1, [&](std::size_t b, std::size_t) {
    blocks_[b] = compress_block(fields, b * FieldBlock::points, places, bound, std::span(errors).subspan(b * fields_, fields_));
  });
  for (std::size_t i = 0; i < errors.size(); ++i) errors_[i % fields_] = std::max(errors_[i % fields_], errors[i]);
}

bool CompressedFields::fits(std::size_t points, std::size_t fields) const {
  if (points_ != points || fields_ != fields || errors_.size() != fields || blocks_.size() != block_count(points)) return false;
  for (std::size_t b = 0; b < blocks_.size(); ++b) {
    const FieldBlock& block = blocks_[b];
    const std::size_t tiles = tile_count(std::min(FieldBlock::points, points - b * FieldBlock::points));
    if (!block.exact.empty()) {
      if (block.exact.size() != tiles * tile_size * fields) return false;
      continue;
    }
    const std::size_t columns = block.columns();
    std::size_t tile_bytes = 0;
    for (const std::uint8_t bits : block.bits) tile_bytes += coded_bytes(bits);
    const bool coded =
        std::all_of(block.bits.begin(), block.bits.end(), [](std::uint8_t bits) { return bits % 4 == 0 && bits <= 32; });
    const bool whole = coded && block.stride % 4 == 0 && block.affine.size() == fields * affine_terms &&
                       block.steps.size() == columns && block.offsets.size() == columns && block.stride >= columns &&
                       block.tile_bytes == tile_bytes && block.directions.size() == fields * block.stride &&
                       block.codes.size() == tiles * tile_bytes;
    if (!whole) return false;
  }
  return true;
}

std::size_t CompressedFields::bytes() const {
  std::size_t bytes = errors_.size() * sizeof(double);
  for (const FieldBlock& block : blocks_) bytes += block.bytes();
  return bytes;
}

std::size_t CompressedFields::bytes_for(std::size_t points, std::size_t fields, double bound) {
  // That few columns serve many fields is not counted on, nor that neighbours resemble each other. Bits to either side of the
  // bound and of steps that are finer than it, and since columns have multiples of four; beyond most_bits doubles may take less.
  constexpr double more_bits = 8, most_bits = 44;
  const double bits = std::ceil(std::log2(1 / bound)) + more_bits;
  const std::size_t plain = FieldTiles::bytes_for(points, fields), blocks = block_count(points) * sizeof(FieldBlock);
  const std::size_t constant = blocks + fields * sizeof(double);
  if (bits > most_bits) return plain + constant;
  const auto codes = static_cast<std::size_t>(static_cast<double>(plain) * std::max(bits, 4.0) / 64);
  const std::size_t tables = block_count(points) * fields * (affine_terms * sizeof(double) + (fields + 4) * sizeof(float) + 17);
  return std::min(plain, codes + tables) + constant;
}

std::vector<double> CompressedFields::transposed_product(std::span<const Vec3> X, std::span<const Vec3> places,
                                                         const RunContext& context) const {
  const std::size_t tasks = (blocks_.size() + blocks_per_task - 1) / blocks_per_task;
  std::vector<std::vector<double>> partial(tasks, std::vector<double>(fields_ * 3, 0.0));
  parallel_for(context, blocks_.size(), blocks_per_task, [&](std::size_t begin, std::size_t end) {
    std::vector<double>& sums = partial[begin / blocks_per_task];
    std::vector<double> rows, along;
    double columns[3 * tile_size];
    for (std::size_t b = begin; b < end; ++b) {
      const FieldBlock& block = blocks_[b];
      const std::size_t terms = affine_terms + block.columns();
      along.assign(3 * terms, 0.0);
      const std::size_t first = b * FieldBlock::points, last = std::min(points_, first + FieldBlock::points);
      for (std::size_t at = first; at < last; at += tile_size) {
        const std::size_t count = std::min(tile_size, last - at);
        for (std::size_t i = 0; i < tile_size; ++i) {
          for (std::size_t k = 0; k < 3; ++k) columns[k * tile_size + i] = i < count ? X[at + i][k] : 0.0;
        }
        const std::size_t tile = (at - first) / tile_size;
        if (!block.exact.empty()) {
          const double* exact = block.exact.data() + tile * fields_ * tile_size;
          tile_product_transposed(exact, fields_, columns, 3, sums.data(), 3);
          continue;
        }
        fill_rows(block, tile, places.subspan(at, count), rows);
        tile_product_transposed(rows.data(), terms, columns, 3, along.data(), 3);
      }
      if (!block.exact.empty()) continue;
      // along[0] is the sum of X, which the offsets take; then back to the fields.
      for (std::size_t f = 0; f < fields_; ++f) {
        for (std::size_t k = 0; k < 3; ++k) {
          double sum = 0;
          for (std::size_t t = 0; t < affine_terms; ++t) sum += block.affine[f * affine_terms + t] * along[3 * t + k];
          for (std::size_t c = 0; c < block.columns(); ++c) {
            const double value = block.steps[c] * along[3 * (affine_terms + c) + k] + block.offsets[c] * along[k];
            sum += static_cast<double>(block.directions[f * block.stride + c]) * value;
          }
          sums[3 * f + k] += sum;
        }
      }
    }
  });
  std::vector<double> result(fields_ * 3, 0.0);
  for (const auto& sums : partial) {
    for (std::size_t k = 0; k < result.size(); ++k) result[k] += sums[k];
  }
  return result;
}

/// The coefficients of the rows of a block, from those of the fields.
void CompressedSums::enter(std::size_t block_number) {
  block_ = block_number;
  const FieldBlock& block = fields_.blocks_[block_number];
  if (!block.exact.empty()) return;
  along_.assign(columns_ * block.stride, 0.0);
  add_weighted_rows(block.directions.data(), block.stride, rows_, B_, ldb_, columns_, along_.data());
  coefficients_.assign((affine_terms + block.columns()) * columns_, 0.0);
  for (const std::uint32_t f : rows_) {
    for (std::size_t t = 0; t < affine_terms; ++t) {
      const double weight = block.affine[f * affine_terms + t];
      for (std::size_t c = 0; c < columns_; ++c) coefficients_[t * columns_ + c] += weight * B_[f * ldb_ + c];
    }
  }
  for (std::size_t k = 0; k < block.columns(); ++k) {
    for (std::size_t c = 0; c < columns_; ++c) {
      const double along = along_[c * block.stride + k];
      coefficients_[c] += block.offsets[k] * along;
      coefficients_[(affine_terms + k) * columns_ + c] = block.steps[k] * along;
    }
  }
}

void CompressedSums::add_tile(std::size_t tile, std::span<const Vec3> places, std::size_t first, std::size_t count, double* out) {
  const std::size_t block_number = tile / FieldBlock::tiles, inside = tile % FieldBlock::tiles;
  const FieldBlock& block = fields_.blocks_[block_number];
  if (!block.exact.empty()) {
    const double* exact = block.exact.data() + inside * fields_.fields_ * tile_size;
    tile_product(exact, fields_.fields_, rows_, B_ + first, ldb_, count, out);
    return;
  }
  if (block_ != block_number) enter(block_number);
  ask_for_next(inside);
  const double* const B = coefficients_.data() + first;
  if (count == 3) {  // of one design: what is decoded is used once
    double affine[affine_terms * tile_size];
    block.affine_rows(places, affine);
    tile_product(affine, affine_terms, B, columns_, count, out);
    add_coded_products(block.codes.data() + inside * block.tile_bytes, block.bits, B + affine_terms * columns_, columns_, out);
    return;
  }
  fill_rows(block, inside, places, values_);
  tile_product(values_.data(), affine_terms + block.columns(), B, columns_, count, out);
}

void CompressedSums::ask_for_next(std::size_t inside) const {
  if (block_ + 1 >= fields_.blocks_.size()) return;
  const auto ask = [&](const auto& array) { prefetch_share(std::as_bytes(std::span(array)), inside, FieldBlock::tiles); };
  const FieldBlock& next = fields_.blocks_[block_ + 1];
  ask(next.directions);
  ask(next.affine);
  ask(next.steps);
  ask(next.offsets);
}

}  // namespace deform
