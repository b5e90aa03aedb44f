// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/kernels/coded_tiles.h"

#include <algorithm>
#include <bit>
#include <cstring>

// Compiled once per instruction set, as tiles.cpp is.
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_RVV)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/numerics/kernels/coded_tiles.cpp"
#include <hwy/foreach_target.h>  // must come before highway.h

#include <hwy/cache_control.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace deform::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using D = hn::CappedTag<double, 8>;
using Codes = hn::Rebind<std::uint32_t, D>;
using Shorts = hn::Rebind<std::uint16_t, D>;
using Bytes = hn::Rebind<std::uint8_t, D>;
using Signed = hn::Rebind<std::int32_t, D>;
constexpr std::size_t lanes = HWY_MIN(HWY_LANES(double), 8);
constexpr std::size_t half = tile_size / 2;

HWY_INLINE hn::Vec<Codes> widened(const std::uint8_t* from) { return hn::PromoteTo(Codes(), hn::LoadU(Bytes(), from)); }
HWY_INLINE hn::Vec<D> doubles(hn::Vec<Codes> codes) { return hn::PromoteTo(D(), hn::BitCast(Signed(), codes)); }

/// Gives the numbers of a column to `take`, a vector after the other: take.at(first point, numbers).
template <bool Nibbles, bool OneByte, bool TwoBytes, typename Take>
HWY_INLINE void column(const std::uint8_t* HWY_RESTRICT from, Take& take) {
  const std::uint8_t* bytes = from + (Nibbles ? coded_bytes(4) : 0);
  const auto* shorts = reinterpret_cast<const std::uint16_t*>(bytes + (OneByte ? coded_bytes(8) : 0));
  for (std::size_t i = 0; i < tile_size; i += lanes) {
    auto codes = hn::Zero(Codes());
    if constexpr (TwoBytes) codes = hn::PromoteTo(Codes(), hn::LoadU(Shorts(), shorts + i));
    if constexpr (OneByte) codes = hn::Or(hn::ShiftLeft<8>(codes), widened(bytes + i));
    if constexpr (Nibbles) {  // the first eight points have the lower halves
      const auto pair = widened(from + i % half);
      const auto nibble = i < half ? hn::And(pair, hn::Set(Codes(), 15)) : hn::ShiftRight<4>(pair);
      codes = hn::Or(hn::ShiftLeft<4>(codes), nibble);
    }
    take.at(i, doubles(codes));
  }
}

template <typename Take>
HWY_INLINE void whole_column(const std::uint8_t* HWY_RESTRICT from, Take& take) {
  const auto* codes = reinterpret_cast<const std::uint32_t*>(from);
  for (std::size_t i = 0; i < tile_size; i += lanes) take.at(i, doubles(hn::LoadU(Codes(), codes + i)));
}

template <typename Take>
HWY_INLINE void columns_of(const std::uint8_t* codes, const std::uint8_t* bits, std::size_t columns, Take& take) {
  for (std::size_t c = 0; c < columns; ++c, take.next()) {
    switch (bits[c]) {
      case 0:
        for (std::size_t i = 0; i < tile_size; i += lanes) take.at(i, hn::Zero(D()));
        break;
      case 4:
        column<true, false, false>(codes, take);
        break;
      case 8:
        column<false, true, false>(codes, take);
        break;
      case 12:
        column<true, true, false>(codes, take);
        break;
      case 16:
        column<false, false, true>(codes, take);
        break;
      case 20:
        column<true, false, true>(codes, take);
        break;
      case 24:
        column<false, true, true>(codes, take);
        break;
      case 28:
        column<true, true, true>(codes, take);
        break;
      default:
        whole_column(codes, take);
    }
    codes += coded_bytes(bits[c]);
  }
}

/// Stores the numbers.
struct Stored {
  double* out;
  HWY_INLINE void at(std::size_t i, hn::Vec<D> numbers) { hn::StoreU(numbers, D(), out + i); }
  HWY_INLINE void next() { out += tile_size; }
};

void decode(const std::uint8_t* codes, const std::uint8_t* bits, std::size_t columns, double* out) {
  Stored stored{out};
  columns_of(codes, bits, columns, stored);
}

/// Adds the numbers times three weights of each column to sums that stay in registers.
struct Summed {
  hn::Vec<D> sums[3][tile_size / lanes];
  const double* B;
  std::size_t ldb;
  HWY_INLINE void at(std::size_t i, hn::Vec<D> numbers) {
    for (std::size_t c = 0; c < 3; ++c) sums[c][i / lanes] = hn::MulAdd(numbers, hn::Set(D(), B[c]), sums[c][i / lanes]);
  }
  HWY_INLINE void next() { B += ldb; }
};

void sum_three(const std::uint8_t* codes, const std::uint8_t* bits, std::size_t columns, const double* B, std::size_t ldb,
               double* out) {
  Summed summed;
  summed.B = B;
  summed.ldb = ldb;
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t i = 0; i < tile_size; i += lanes) summed.sums[c][i / lanes] = hn::LoadU(D(), out + c * tile_size + i);
  }
  columns_of(codes, bits, columns, summed);
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t i = 0; i < tile_size; i += lanes) hn::StoreU(summed.sums[c][i / lanes], D(), out + c * tile_size + i);
  }
}

// At most four lanes, so that strides need be multiples of no more.
using Four = hn::CappedTag<double, 4>;
constexpr std::size_t four_lanes = HWY_MIN(HWY_LANES(double), 4);

template <std::size_t Columns>
HWY_INLINE void weighted_block(const float* HWY_RESTRICT A, std::size_t stride, const std::uint32_t* HWY_RESTRICT rows,
                               std::size_t count, const double* HWY_RESTRICT B, std::size_t ldb, double* HWY_RESTRICT out) {
  const Four d;
  const hn::Rebind<float, Four> floats;
  for (std::size_t k = 0; k < stride; k += four_lanes) {
    hn::Vec<Four> sum[Columns];
    for (std::size_t c = 0; c < Columns; ++c) sum[c] = hn::LoadU(d, out + c * stride + k);
    for (std::size_t r = 0; r < count; ++r) {
      const auto a = hn::PromoteTo(d, hn::LoadU(floats, A + rows[r] * stride + k));
      for (std::size_t c = 0; c < Columns; ++c) sum[c] = hn::MulAdd(a, hn::Set(d, B[rows[r] * ldb + c]), sum[c]);
    }
    for (std::size_t c = 0; c < Columns; ++c) hn::StoreU(sum[c], d, out + c * stride + k);
  }
}

void weighted_rows(const float* A, std::size_t stride, const std::uint32_t* rows, std::size_t count, const double* B,
                   std::size_t ldb, std::size_t columns, double* out) {
  std::size_t c = 0;
  for (; c + 3 <= columns; c += 3) weighted_block<3>(A, stride, rows, count, B + c, ldb, out + c * stride);
  for (; c < columns; ++c) weighted_block<1>(A, stride, rows, count, B + c, ldb, out + c * stride);
}

}  // namespace deform::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace deform {

HWY_EXPORT(decode);
HWY_EXPORT(sum_three);
HWY_EXPORT(weighted_rows);

unsigned code_bits(std::uint32_t largest) { return (static_cast<unsigned>(std::bit_width(largest)) + 3) / 4 * 4; }

void encode_column(const std::uint32_t* values, unsigned bits, std::uint8_t* to) {
  if (bits == 32) {
    std::memcpy(to, values, coded_bytes(32));
    return;
  }
  unsigned shift = 0;
  if (bits % 8 != 0) {
    for (std::size_t i = 0; i < tile_size / 2; ++i) {
      to[i] = static_cast<std::uint8_t>((values[i] & 15u) | (values[i + tile_size / 2] & 15u) << 4);
    }
    to += coded_bytes(4);
    shift = 4;
  }
  if (bits / 8 % 2 != 0) {
    for (std::size_t i = 0; i < tile_size; ++i) to[i] = static_cast<std::uint8_t>(values[i] >> shift);
    to += coded_bytes(8);
    shift += 8;
  }
  for (std::size_t i = 0; bits >= 16 && i < tile_size; ++i) {
    const auto part = static_cast<std::uint16_t>(values[i] >> shift);
    std::memcpy(to + 2 * i, &part, sizeof part);
  }
}

void decode_columns(const std::uint8_t* codes, std::span<const std::uint8_t> bits, double* out) {
  HWY_DYNAMIC_DISPATCH(decode)(codes, bits.data(), bits.size(), out);
}

void add_coded_products(const std::uint8_t* codes, std::span<const std::uint8_t> bits, const double* B, std::size_t ldb,
                        double* out) {
  HWY_DYNAMIC_DISPATCH(sum_three)(codes, bits.data(), bits.size(), B, ldb, out);
}

void prefetch_share(std::span<const std::byte> array, std::size_t part, std::size_t parts) {
  constexpr std::size_t line = 64;  // bytes
  const std::size_t share = (array.size() + parts - 1) / parts, end = std::min(array.size(), (part + 1) * share);
  for (std::size_t i = part * share; i < end; i += line) hwy::Prefetch(array.data() + i);
}

void add_weighted_rows(const float* A, std::size_t stride, std::span<const std::uint32_t> rows, const double* B, std::size_t ldb,
                       std::size_t columns, double* out) {
  HWY_DYNAMIC_DISPATCH(weighted_rows)(A, stride, rows.data(), rows.size(), B, ldb, columns, out);
}

}  // namespace deform
#endif
