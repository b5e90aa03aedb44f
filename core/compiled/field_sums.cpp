// SPDX-License-Identifier: Apache-2.0
#include "core/compiled/field_sums.h"

#include <cmath>

#include "core/compiled/content.h"

#if (defined(__x86_64__) || defined(__i386__)) && (defined(__GNUC__) || defined(__clang__))
#define DEFORM_COMPILED_X86 1
#include <immintrin.h>
#endif

namespace deform::compiled {

namespace {

using Rows = std::span<const std::uint32_t>;

/// What every machine can do; std::fma rounds once also where the processor has no such instruction.
void plain_sums(const double* tile, Rows rows, const double* B, std::size_t ldb, std::size_t columns, double* out) {
  for (std::size_t c = 0; c < columns; ++c) {
    double sums[tile_points] = {};
    for (const std::uint32_t r : rows) {
      const double b = B[r * ldb + c];
      for (std::size_t i = 0; i < tile_points; ++i) sums[i] = std::fma(tile[r * tile_points + i], b, sums[i]);
    }
    for (std::size_t i = 0; i < tile_points; ++i) out[c * tile_points + i] = sums[i];
  }
}

void plain_products(const double* tile, std::size_t fields, const double* X, double* sums) {
  for (std::size_t r = 0; r < fields; ++r) {
    for (std::size_t c = 0; c < 3; ++c) {
      double* const sum = sums + (3 * r + c) * tile_points;
      for (std::size_t i = 0; i < tile_points; ++i) {
        sum[i] = std::fma(tile[r * tile_points + i], X[c * tile_points + i], sum[i]);
      }
    }
  }
}

#ifdef DEFORM_COMPILED_X86

#define DEFORM_AVX2 __attribute__((target("avx2,fma")))
#define DEFORM_AVX512 __attribute__((target("avx512f")))

/// `Columns` columns of half a tile in registers.
template <std::size_t Columns>
DEFORM_AVX2 inline void half_sums(const double* tile, Rows rows, const double* B, std::size_t ldb, double* out) {
  __m256d low[Columns], high[Columns];
  for (std::size_t c = 0; c < Columns; ++c) low[c] = high[c] = _mm256_setzero_pd();
  for (const std::uint32_t r : rows) {
    const __m256d a = _mm256_loadu_pd(tile + r * tile_points), b = _mm256_loadu_pd(tile + r * tile_points + 4);
    for (std::size_t c = 0; c < Columns; ++c) {
      const __m256d weight = _mm256_broadcast_sd(B + r * ldb + c);
      low[c] = _mm256_fmadd_pd(a, weight, low[c]);
      high[c] = _mm256_fmadd_pd(b, weight, high[c]);
    }
  }
  for (std::size_t c = 0; c < Columns; ++c) {
    _mm256_storeu_pd(out + c * tile_points, low[c]);
    _mm256_storeu_pd(out + c * tile_points + 4, high[c]);
  }
}

DEFORM_AVX2 void avx2_sums(const double* tile, Rows rows, const double* B, std::size_t ldb, std::size_t columns, double* out) {
  constexpr std::size_t half = tile_points / 2;
  std::size_t c = 0;
  for (; c + 6 <= columns; c += 6) {
    half_sums<6>(tile, rows, B + c, ldb, out + c * tile_points);
    half_sums<6>(tile + half, rows, B + c, ldb, out + c * tile_points + half);
  }
  for (; c < columns; ++c) {
    half_sums<1>(tile, rows, B + c, ldb, out + c * tile_points);
    half_sums<1>(tile + half, rows, B + c, ldb, out + c * tile_points + half);
  }
}

DEFORM_AVX2 void avx2_products(const double* tile, std::size_t fields, const double* X, double* sums) {
  for (std::size_t r = 0; r < fields; ++r) {
    for (std::size_t i = 0; i < tile_points; i += 4) {
      const __m256d a = _mm256_loadu_pd(tile + r * tile_points + i);
      for (std::size_t c = 0; c < 3; ++c) {
        double* const sum = sums + (3 * r + c) * tile_points + i;
        _mm256_storeu_pd(sum, _mm256_fmadd_pd(a, _mm256_loadu_pd(X + c * tile_points + i), _mm256_loadu_pd(sum)));
      }
    }
  }
}

template <std::size_t Columns>
DEFORM_AVX512 inline void wide_sums(const double* tile, Rows rows, const double* B, std::size_t ldb, double* out) {
  __m512d low[Columns], high[Columns];
  for (std::size_t c = 0; c < Columns; ++c) low[c] = high[c] = _mm512_setzero_pd();
  for (const std::uint32_t r : rows) {
    const __m512d a = _mm512_loadu_pd(tile + r * tile_points), b = _mm512_loadu_pd(tile + r * tile_points + 8);
    for (std::size_t c = 0; c < Columns; ++c) {
      const __m512d weight = _mm512_set1_pd(B[r * ldb + c]);
      low[c] = _mm512_fmadd_pd(a, weight, low[c]);
      high[c] = _mm512_fmadd_pd(b, weight, high[c]);
    }
  }
  for (std::size_t c = 0; c < Columns; ++c) {
    _mm512_storeu_pd(out + c * tile_points, low[c]);
    _mm512_storeu_pd(out + c * tile_points + 8, high[c]);
  }
}

DEFORM_AVX512 void avx512_sums(const double* tile, Rows rows, const double* B, std::size_t ldb, std::size_t columns,
                               double* out) {
  std::size_t c = 0;
  for (; c + 9 <= columns; c += 9) wide_sums<9>(tile, rows, B + c, ldb, out + c * tile_points);
  for (; c + 3 <= columns; c += 3) wide_sums<3>(tile, rows, B + c, ldb, out + c * tile_points);
  for (; c < columns; ++c) wide_sums<1>(tile, rows, B + c, ldb, out + c * tile_points);
}

#endif

using SumsFunction = void (*)(const double*, Rows, const double*, std::size_t, std::size_t, double*);
using ProductsFunction = void (*)(const double*, std::size_t, const double*, double*);

SumsFunction best_sums() {
#ifdef DEFORM_COMPILED_X86
  if (__builtin_cpu_supports("avx512f")) return avx512_sums;
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return avx2_sums;
#endif
  return plain_sums;
}

ProductsFunction best_products() {
#ifdef DEFORM_COMPILED_X86
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return avx2_products;
#endif
  return plain_products;
}

}  // namespace

void field_sums(const double* tile, Rows rows, const double* B, std::size_t ldb, std::size_t columns, double* out) {
  static const SumsFunction best = best_sums();
  best(tile, rows, B, ldb, columns, out);
}

void add_products(const double* tile, std::size_t fields, const double* X, double* sums) {
  static const ProductsFunction best = best_products();
  best(tile, fields, X, sums);
}

}  // namespace deform::compiled
