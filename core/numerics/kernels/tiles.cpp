// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/kernels/tiles.h"

#include <algorithm>
#include <cstring>

#include "core/base/parallel.h"

// Compiled once per instruction set; the calls below pick the best one at run time. Scalable vectors cannot be stored in arrays.
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_RVV)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/numerics/kernels/tiles.cpp"
#include <hwy/foreach_target.h>  // must come before highway.h

#include <hwy/cache_control.h>
#include <hwy/highway.h>

#include <hwy/contrib/math/math-inl.h>

#include "core/numerics/kernels/radial_functions-inl.h"

HWY_BEFORE_NAMESPACE();
namespace deform::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using D = hn::CappedTag<double, 8>;
using V = hn::Vec<D>;
constexpr std::size_t lanes = HWY_MIN(HWY_LANES(double), 8);

/// A vector as the number type of the kernels.
struct Lanes {
  V v;
};
HWY_INLINE Lanes constant(double x) { return {hn::Set(D(), x)}; }
HWY_INLINE Lanes operator+(Lanes a, double b) { return {hn::Add(a.v, constant(b).v)}; }
HWY_INLINE Lanes operator-(double a, Lanes b) { return {hn::Sub(constant(a).v, b.v)}; }
HWY_INLINE Lanes operator*(Lanes a, Lanes b) { return {hn::Mul(a.v, b.v)}; }
HWY_INLINE Lanes operator*(Lanes a, double b) { return a * constant(b); }
HWY_INLINE Lanes sqrt(Lanes a) { return {hn::Sqrt(a.v)}; }
HWY_INLINE Lanes exp(Lanes a) { return {hn::Exp(D(), a.v)}; }
HWY_INLINE Lanes finite_log(Lanes a) { return {hn::Log(D(), hn::Max(a.v, constant(1e-300).v))}; }
HWY_INLINE Lanes reciprocal(Lanes a) { return {hn::Div(constant(1).v, a.v)}; }
HWY_INLINE Lanes positive_part(Lanes a) { return {hn::Max(hn::Zero(D()), a.v)}; }
HWY_INLINE Lanes multiply_add(double a, Lanes x, double b) { return {hn::MulAdd(constant(a).v, x.v, constant(b).v)}; }

/// Which rows of A and B a product sums over.
struct AllRows {
  std::size_t count;
  HWY_INLINE std::size_t operator[](std::size_t k) const { return k; }
};
struct SomeRows {
  std::size_t count;
  const std::uint32_t* rows;
  HWY_INLINE std::size_t operator[](std::size_t k) const { return rows[k]; }
};

/// What a product asks memory for while it computes.
struct Nothing {
  template <std::size_t Height>
  HWY_INLINE void ask(const double*) const {}
};
/// What is so many bytes behind the row.
struct RowsAhead {
  std::uintptr_t distance;
  template <std::size_t Height>
  HWY_INLINE void ask(const double* row) const {
    constexpr std::size_t line = 64;  // bytes
    // A number and no pointer: there may be no such tile.
    const std::uintptr_t ahead = reinterpret_cast<std::uintptr_t>(row) + distance;
    for (std::size_t i = 0; i < Height * sizeof(double); i += line) hwy::Prefetch(reinterpret_cast<const char*>(ahead + i));
  }
};

// `Height` points (a multiple of the vector length) times `Columns` columns, accumulated in registers.
template <std::size_t Height, std::size_t Columns, typename Rows, typename Ahead>
HWY_INLINE void product_block(const double* HWY_RESTRICT A, const Rows& rows, const Ahead& ahead, const double* HWY_RESTRICT B,
                              std::size_t ldb, double* HWY_RESTRICT out) {
  const D d;
  constexpr std::size_t vectors = Height / lanes;
  V sum[Columns][vectors];
  for (std::size_t c = 0; c < Columns; ++c) {
    for (std::size_t v = 0; v < vectors; ++v) sum[c][v] = hn::LoadU(d, out + c * tile_size + v * lanes);
  }
  for (std::size_t k = 0; k < rows.count; ++k) {
    const double* HWY_RESTRICT row = A + rows[k] * tile_size;
    ahead.template ask<Height>(row);
    V a[vectors];
    for (std::size_t v = 0; v < vectors; ++v) a[v] = hn::LoadU(d, row + v * lanes);
    for (std::size_t c = 0; c < Columns; ++c) {
      const V b = hn::Set(d, B[rows[k] * ldb + c]);
      for (std::size_t v = 0; v < vectors; ++v) sum[c][v] = hn::MulAdd(a[v], b, sum[c][v]);
    }
  }
  for (std::size_t c = 0; c < Columns; ++c) {
    for (std::size_t v = 0; v < vectors; ++v) hn::StoreU(sum[c][v], d, out + c * tile_size + v * lanes);
  }
}

// A third of a tile's registers hold three columns at full height; wider products use half the height and twice the columns.
constexpr std::size_t half = tile_size / 2;

template <std::size_t Columns, typename Rows, typename Ahead>
HWY_INLINE void product_columns(const double* A, const Rows& rows, const Ahead& ahead, const double* B, std::size_t ldb,
                                double* out) {
  if constexpr (Columns > 3) {
    product_block<half, Columns>(A, rows, ahead, B, ldb, out);
    product_block<half, Columns>(A + half, rows, ahead, B, ldb, out + half);
  } else {
    product_block<tile_size, Columns>(A, rows, ahead, B, ldb, out);
  }
}

/// As many columns at a time as long as there are so many. The first ones ask for what is ahead.
template <std::size_t Columns, typename Rows, typename Ahead>
HWY_INLINE void product_groups(const double* A, const Rows& rows, const Ahead& ahead, const double* B, std::size_t ldb,
                               std::size_t columns, std::size_t& c, double* out) {
  for (; c + Columns <= columns; c += Columns) {
    if (c == 0) {
      product_columns<Columns>(A, rows, ahead, B, ldb, out);
    } else {
      product_columns<Columns>(A, rows, Nothing(), B + c, ldb, out + c * tile_size);
    }
  }
}

template <typename Rows, typename Ahead>
HWY_INLINE void product_of(const double* A, const Rows& rows, const Ahead& ahead, const double* B, std::size_t ldb,
                           std::size_t columns, double* out) {
  std::size_t c = 0;
  product_groups<6>(A, rows, ahead, B, ldb, columns, c, out);
  product_groups<3>(A, rows, ahead, B, ldb, columns, c, out);
  product_groups<1>(A, rows, ahead, B, ldb, columns, c, out);
}

void product(const double* A, std::size_t K, const double* B, std::size_t ldb, std::size_t columns, double* out) {
  product_of(A, AllRows{K}, Nothing(), B, ldb, columns, out);
}

// Far enough that memory has answered by then, near enough to be there still. Processors themselves look ahead within a page
// only, and not where there are gaps between rows.
constexpr std::size_t bytes_ahead = 8192, most_tiles_ahead = 4;

void product_of_rows(const double* A, std::size_t K, const std::uint32_t* rows, std::size_t count, const double* B,
                     std::size_t ldb, std::size_t columns, double* out) {
  constexpr std::size_t row = tile_size * sizeof(double);
  if (count == K) return product_of(A, AllRows{K}, RowsAhead{bytes_ahead}, B, ldb, columns, out);
  const std::size_t tiles = HWY_MIN(bytes_ahead / (count * row + 1) + 1, most_tiles_ahead);
  product_of(A, SomeRows{count, rows}, RowsAhead{tiles * K * row}, B, ldb, columns, out);
}

void positions(const Vec3* HWY_RESTRICT places, double keep, const double* HWY_RESTRICT values, Vec3* HWY_RESTRICT out) {
  const D d;
  const V factor = hn::Set(d, keep);
  for (std::size_t i = 0; i < tile_size; i += lanes) {
    V x, y, z;
    hn::LoadInterleaved3(d, places[i].data(), x, y, z);
    x = hn::MulAdd(factor, x, hn::LoadU(d, values + i));
    y = hn::MulAdd(factor, y, hn::LoadU(d, values + tile_size + i));
    z = hn::MulAdd(factor, z, hn::LoadU(d, values + 2 * tile_size + i));
    hn::StoreInterleaved3(x, y, z, d, out[i].data());
  }
}

void product_transposed(const double* HWY_RESTRICT A, std::size_t K, const double* HWY_RESTRICT X, std::size_t columns,
                        double* HWY_RESTRICT out, std::size_t ldo) {
  const D d;
  for (std::size_t k = 0; k < K; ++k) {
    for (std::size_t c = 0; c < columns; ++c) {
      V sum = hn::Zero(d);
      for (std::size_t i = 0; i < tile_size; i += lanes) {
        sum = hn::MulAdd(hn::LoadU(d, A + k * tile_size + i), hn::LoadU(d, X + c * tile_size + i), sum);
      }
      out[k * ldo + c] += hn::GetLane(hn::SumOfLanes(d, sum));
    }
  }
}

template <typename Phi>
HWY_INLINE void kernel_rows(const Phi& phi, const double* HWY_RESTRICT tile, const Vec3* HWY_RESTRICT centres, std::size_t count,
                            double* HWY_RESTRICT out) {
  const D d;
  for (std::size_t j = 0; j < count; ++j) {
    const V cx = hn::Set(d, centres[j][0]);
    const V cy = hn::Set(d, centres[j][1]);
    const V cz = hn::Set(d, centres[j][2]);
    for (std::size_t i = 0; i < tile_size; i += lanes) {
      const V x = hn::Sub(hn::LoadU(d, tile + i), cx);
      const V y = hn::Sub(hn::LoadU(d, tile + tile_size + i), cy);
      const V z = hn::Sub(hn::LoadU(d, tile + 2 * tile_size + i), cz);
      const V r2 = hn::MulAdd(x, x, hn::MulAdd(y, y, hn::Mul(z, z)));
      hn::StoreU(phi(Lanes{r2}).v, d, out + j * tile_size + i);
    }
  }
}

/// The same with the images of every centre, in their order.
template <typename Phi>
HWY_INLINE void mirrored_rows(const Phi& phi, const Images& images, const double* HWY_RESTRICT tile,
                              const Vec3* HWY_RESTRICT centres, std::size_t count, double* HWY_RESTRICT out) {
  const D d;
  for (std::size_t j = 0; j < count; ++j) {
    for (std::size_t i = 0; i < tile_size; i += lanes) {
      V sum = hn::Zero(d);
      for (std::size_t g = 0; g < images.count; ++g) {
        const Vec3 c = images.at[g].of(centres[j]);
        const V x = hn::Sub(hn::LoadU(d, tile + i), hn::Set(d, c[0]));
        const V y = hn::Sub(hn::LoadU(d, tile + tile_size + i), hn::Set(d, c[1]));
        const V z = hn::Sub(hn::LoadU(d, tile + 2 * tile_size + i), hn::Set(d, c[2]));
        const V r2 = hn::MulAdd(x, x, hn::MulAdd(y, y, hn::Mul(z, z)));
        sum = hn::MulAdd(hn::Set(d, images.at[g].sign), phi(Lanes{r2}).v, sum);
      }
      hn::StoreU(sum, d, out + j * tile_size + i);
    }
  }
}

void kernel_tile(const RadialKernel& kernel, const double* tile, const Vec3* centres, std::size_t count, double* out) {
  const Images images(kernel.parity);
  AllKernels::visit(kernel, [&](const auto& phi) {
    images.count == 1 ? kernel_rows(phi, tile, centres, count, out) : mirrored_rows(phi, images, tile, centres, count, out);
  });
}

void kernel_tile_sums(const RadialKernel& kernel, const double* tile, const Vec3* centres, std::size_t count,
                      const double* weights, std::size_t ldw, std::size_t columns, double* out) {
  constexpr std::size_t chunk = 64;  // 8 KiB of kernel values stay in the first-level cache
  HWY_ALIGN double values[chunk * tile_size];
  const Images images(kernel.parity);
  AllKernels::visit(kernel, [&](const auto& phi) {
    for (std::size_t begin = 0; begin < count; begin += chunk) {
      const std::size_t size = HWY_MIN(chunk, count - begin);
      if (images.count == 1) {
        kernel_rows(phi, tile, centres + begin, size, values);
      } else {
        mirrored_rows(phi, images, tile, centres + begin, size, values);
      }
      product(values, size, weights + begin * ldw, ldw, columns, out);
    }
  });
}

const char* target_name() { return hwy::TargetName(HWY_TARGET); }

}  // namespace deform::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace deform {

HWY_EXPORT(product);
HWY_EXPORT(product_of_rows);
HWY_EXPORT(positions);
HWY_EXPORT(product_transposed);
HWY_EXPORT(kernel_tile);
HWY_EXPORT(kernel_tile_sums);
HWY_EXPORT(target_name);

TiledPoints::TiledPoints(std::span<const Vec3> points) : count_(points.size()), xyz_(tile_count(points.size()) * 3 * tile_size) {
  for (std::size_t i = 0; i < tile_count(count_) * tile_size; ++i) {
    const Vec3& p = points[std::min(i, count_ - 1)];
    double* to = xyz_.data() + (i / tile_size) * 3 * tile_size + i % tile_size;
    for (std::size_t k = 0; k < 3; ++k) to[k * tile_size] = p[k];
  }
}

void tile_product(const double* A, std::size_t K, const double* B, std::size_t ldb, std::size_t columns, double* out) {
  HWY_DYNAMIC_DISPATCH(product)(A, K, B, ldb, columns, out);
}

void tile_product(const double* A, std::size_t K, std::span<const std::uint32_t> rows, const double* B, std::size_t ldb,
                  std::size_t columns, double* out) {
  HWY_DYNAMIC_DISPATCH(product_of_rows)(A, K, rows.data(), rows.size(), B, ldb, columns, out);
}

void tile_positions(const Vec3* places, double keep, const double* values, Vec3* out) {
  HWY_DYNAMIC_DISPATCH(positions)(places, keep, values, out);
}

void tile_product_transposed(const double* A, std::size_t K, const double* X, std::size_t columns, double* out, std::size_t ldo) {
  HWY_DYNAMIC_DISPATCH(product_transposed)(A, K, X, columns, out, ldo);
}

void tile_kernel(const RadialKernel& kernel, const double* tile, std::span<const Vec3> centres, double* out) {
  HWY_DYNAMIC_DISPATCH(kernel_tile)(kernel, tile, centres.data(), centres.size(), out);
}

void tile_kernel_sums(const RadialKernel& kernel, const double* tile, std::span<const Vec3> centres, const double* weights,
                      std::size_t ldw, std::size_t columns, double* out) {
  HWY_DYNAMIC_DISPATCH(kernel_tile_sums)(kernel, tile, centres.data(), centres.size(), weights, ldw, columns, out);
}

std::vector<double> kernel_sums(const RadialKernel& kernel, std::span<const Vec3> points, std::span<const Vec3> centres,
                                std::span<const double> weights, std::size_t columns, const RunContext& context) {
  std::vector<double> result(points.size() * columns);
  // About a million kernel evaluations between two checks of the context.
  const std::size_t grain = std::max<std::size_t>(1, (std::size_t{1} << 16) / (centres.size() + 1)) * tile_size;
  parallel_for(context, points.size(), grain, [&](std::size_t begin, std::size_t end) {
    const TiledPoints tiled(points.subspan(begin, end - begin));
    std::vector<double> sums(columns * tile_size);
    for (std::size_t t = 0; t < tiled.tiles(); ++t) {
      std::fill(sums.begin(), sums.end(), 0.0);
      tile_kernel_sums(kernel, tiled.tile(t), centres, weights.data(), columns, columns, sums.data());
      const std::size_t first = begin + t * tile_size;
      for (std::size_t i = first; i < std::min(first + tile_size, end); ++i) {
        for (std::size_t c = 0; c < columns; ++c) result[i * columns + c] = sums[c * tile_size + (i - first)];
      }
    }
  });
  return result;
}

const char* vector_target() { return HWY_DYNAMIC_DISPATCH(target_name)(); }

}  // namespace deform
#endif
