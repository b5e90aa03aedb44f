// SPDX-License-Identifier: Apache-2.0
#include "core/compiled/coded_fields.h"

#include <algorithm>
#include <cstring>
#include <numeric>
#include <string>

#include "core/base/error.h"
#include "core/compiled/content.h"
#include "core/compiled/layout.h"

namespace deform::compiled {

namespace {

constexpr std::uint32_t exact_block = 0xffffffffu;  // in the place of the number of columns
constexpr std::size_t start_bytes = 8, frame_bytes = 4 * sizeof(double), affine_terms = 4;

std::size_t tiles_of(std::size_t points) { return (points + tile_points - 1) / tile_points; }
std::size_t column_bytes(unsigned bits) { return bits * tile_points / 8; }

template <typename T>
void append_array(std::span<const T> from, std::vector<std::byte>& to) {
  const auto bytes = std::as_bytes(from);
  to.insert(to.end(), bytes.begin(), bytes.end());
}

/// Takes arrays from the bytes of one block after the other.
class Taker {
 public:
  explicit Taker(std::span<const std::byte> bytes) : bytes_(bytes) {}
  template <typename T>
  std::vector<T> take(std::size_t count) {
    if (count > (bytes_.size() - at_) / sizeof(T)) {
      throw Error(ErrorCode::data_loss, "compiled deformation: CODE: block " + std::to_string(block) + " is cut off");
    }
    std::vector<T> result(count);
    if (count > 0) std::memcpy(result.data(), bytes_.data() + at_, count * sizeof(T));
    at_ += count * sizeof(T);
    return result;
  }
  void align() { at_ = std::min(padded(at_), bytes_.size()); }
  bool at_end() const { return at_ == bytes_.size(); }

  std::size_t block = 0;

 private:
  std::span<const std::byte> bytes_;
  std::size_t at_ = 0;
};

/// The 16 numbers of a column: the lowest 4 bits of two points in a byte where their number is odd in fours, then 8 bits where it
/// is odd in eights, then the 16 bits above; of 32 bits the whole numbers.
void decode_column(const std::uint8_t* from, unsigned bits, std::uint32_t* values) {
  std::fill_n(values, tile_points, 0u);
  if (bits == most_code_bits) {
    std::memcpy(values, from, column_bytes(bits));
    return;
  }
  unsigned shift = 0;
  if (bits % 8 != 0) {
    constexpr std::size_t half = tile_points / 2;
    for (std::size_t i = 0; i < half; ++i) {
      values[i] = from[i] & 15u;
      values[i + half] = static_cast<std::uint32_t>(from[i]) >> 4;
    }
    from += column_bytes(4);
    shift = 4;
  }
  if (bits / 8 % 2 != 0) {
    for (std::size_t i = 0; i < tile_points; ++i) values[i] |= static_cast<std::uint32_t>(from[i]) << shift;
    from += column_bytes(8);
    shift += 8;
  }
  for (std::size_t i = 0; bits >= 16 && i < tile_points; ++i) {
    std::uint16_t part = 0;
    std::memcpy(&part, from + 2 * i, sizeof part);
    values[i] |= static_cast<std::uint32_t>(part) << shift;
  }
}

/// What a block is made of, its codes aside.
struct Parts {
  Vec3 centre{};
  double inverse_radius = 1;
  std::vector<double> affine, steps, offsets;
  std::vector<float> directions;
  std::vector<std::uint8_t> bits;
};

/// One tile of at most 16 places: out[field][16].
void decode_tile(const Parts& parts, const std::uint8_t* codes, std::span<const Vec3> places, std::size_t fields,
                 std::vector<double>& columns, double* out) {
  const std::size_t count = parts.bits.size();
  columns.resize(count * tile_points);
  std::uint32_t values[tile_points];
  for (std::size_t k = 0; k < count; ++k) {
    decode_column(codes, parts.bits[k], values);
    codes += column_bytes(parts.bits[k]);
    for (std::size_t i = 0; i < tile_points; ++i) {
      columns[k * tile_points + i] = parts.offsets[k] + parts.steps[k] * static_cast<double>(values[i]);
    }
  }
  double local[affine_terms][tile_points] = {};
  for (std::size_t i = 0; i < places.size(); ++i) {
    local[0][i] = 1;
    for (std::size_t c = 0; c < 3; ++c) local[c + 1][i] = (places[i][c] - parts.centre[c]) * parts.inverse_radius;
  }
  for (std::size_t f = 0; f < fields; ++f) {
    double sums[tile_points] = {};
    for (std::size_t t = 0; t < affine_terms; ++t) {
      for (std::size_t i = 0; i < tile_points; ++i) sums[i] += parts.affine[affine_terms * f + t] * local[t][i];
    }
    for (std::size_t k = 0; k < count; ++k) {
      const auto direction = static_cast<double>(parts.directions[f * count + k]);
      for (std::size_t i = 0; i < tile_points; ++i) sums[i] += direction * columns[k * tile_points + i];
    }
    std::copy_n(sums, tile_points, out + f * tile_points);
  }
}

Parts take_parts(Taker& taker, std::size_t columns, std::size_t fields) {
  Parts parts;
  const std::vector<double> frame = taker.take<double>(4);
  std::copy_n(frame.begin(), 3, parts.centre.begin());
  parts.inverse_radius = frame[3];
  parts.affine = taker.take<double>(affine_terms * fields);
  parts.steps = taker.take<double>(columns);
  parts.offsets = taker.take<double>(columns);
  parts.directions = taker.take<float>(fields * columns);
  parts.bits = taker.take<std::uint8_t>(columns);
  for (const std::uint8_t bits : parts.bits) {
    if (bits <= most_code_bits && bits % 4 == 0) continue;
    throw Error(ErrorCode::data_loss, "compiled deformation: CODE: block " + std::to_string(taker.block) + " has codes of " +
                                          std::to_string(bits) + " bits");
  }
  return parts;
}

}  // namespace

void append_block(const CodedBlock& block, std::size_t fields, std::vector<std::byte>& bytes) {
  const bool exact = !block.exact.empty();
  const auto columns = static_cast<std::uint32_t>(block.bits.size());
  const std::uint32_t start[2] = {exact ? exact_block : columns, 0};
  append_array(std::span<const std::uint32_t>(start), bytes);
  if (exact) return append_array(block.exact, bytes);
  const double frame[4] = {block.centre[0], block.centre[1], block.centre[2], block.inverse_radius};
  append_array(std::span<const double>(frame), bytes);
  append_array(block.affine, bytes);
  append_array(block.steps, bytes);
  append_array(block.offsets, bytes);
  for (std::size_t f = 0; f < fields; ++f) append_array(block.directions.subspan(f * block.stride, columns), bytes);
  append_array(block.bits, bytes);
  append_array(block.codes, bytes);
  bytes.resize(padded(bytes.size()));
}

std::size_t least_coded_bytes(std::size_t points, std::size_t fields) {
  const std::size_t blocks = (points + coded_points - 1) / coded_points;
  return blocks * (start_bytes + frame_bytes + affine_terms * sizeof(double) * fields);
}

std::vector<double> decoded_fields(std::span<const std::byte> bytes, std::span<const Vec3> places, std::size_t fields) {
  // No more than a fixed multiple of the bytes is allocated: what is missing is found first.
  if (bytes.size() < least_coded_bytes(places.size(), fields)) {
    throw Error(ErrorCode::data_loss, "compiled deformation: CODE: " + std::to_string(bytes.size()) + " bytes are too few for " +
                                          std::to_string(places.size()) + " points");
  }
  std::vector<double> values(basis_values(places.size(), fields)), columns;
  Taker taker(bytes);
  for (std::size_t first = 0; first < places.size(); first += coded_points, ++taker.block) {
    const std::size_t points = std::min(coded_points, places.size() - first), tiles = tiles_of(points);
    double* const out = values.data() + first * fields;
    const std::uint32_t count = taker.take<std::uint32_t>(2)[0];
    if (count == exact_block) {
      const std::vector<double> exact = taker.take<double>(tiles * fields * tile_points);
      std::copy(exact.begin(), exact.end(), out);
      continue;
    }
    const Parts parts = take_parts(taker, count, fields);
    std::size_t tile_bytes = 0;
    for (const std::uint8_t bits : parts.bits) tile_bytes += column_bytes(bits);
    const std::vector<std::uint8_t> codes = taker.take<std::uint8_t>(tiles * tile_bytes);
    for (std::size_t t = 0; t < tiles; ++t) {
      const std::size_t low = t * tile_points, high = std::min(points, low + tile_points);
      decode_tile(parts, codes.data() + t * tile_bytes, places.subspan(first + low, high - low), fields, columns,
                  out + t * fields * tile_points);
    }
    taker.align();
  }
  if (!taker.at_end()) throw Error(ErrorCode::data_loss, "compiled deformation: CODE: more bytes than its blocks have");
  return values;
}

}  // namespace deform::compiled
