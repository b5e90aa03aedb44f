// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/kernels/residual.h"

#include <algorithm>

#include "core/base/parallel.h"
#include "core/numerics/kernels/tiles.h"

// Compiled once per instruction set, see tiles.cpp.
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_RVV)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/numerics/kernels/residual.cpp"
#include <hwy/foreach_target.h>  // must come before highway.h

#include <hwy/highway.h>

#include <hwy/contrib/math/math-inl.h>

#include "core/numerics/kernels/radial_functions-inl.h"

HWY_BEFORE_NAMESPACE();
namespace deform::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using D = hn::CappedTag<double, 8>;
using V = hn::Vec<D>;
constexpr std::size_t lanes = HWY_MIN(HWY_LANES(double), 8);

/// The unevaluated sum hi + lo, as a number type of the kernels.
struct Pair {
  V hi, lo;
};

HWY_INLINE Pair fast_two_sum(V a, V b) {  // |a| >= |b|
  const V s = hn::Add(a, b);
  return {s, hn::Sub(b, hn::Sub(s, a))};
}

HWY_INLINE Pair two_sum(V a, V b) {
  const V s = hn::Add(a, b);
  const V t = hn::Sub(s, a);
  return {s, hn::Add(hn::Sub(a, hn::Sub(s, t)), hn::Sub(b, t))};
}

/// a * b exactly. Without a fused multiply-add the factors are split (Dekker); these are of the order of one.
HWY_INLINE Pair two_product(V a, V b) {
  const V p = hn::Mul(a, b);
#if HWY_NATIVE_FMA
  return {p, hn::MulSub(a, b, p)};
#else
  const V splitter = hn::Set(D(), 134217729.0);  // 2^27 + 1
  const V ta = hn::Mul(splitter, a), tb = hn::Mul(splitter, b);
  const V ah = hn::Sub(ta, hn::Sub(ta, a)), bh = hn::Sub(tb, hn::Sub(tb, b));
  const V al = hn::Sub(a, ah), bl = hn::Sub(b, bh);
  const V rest = hn::Sub(p, hn::Mul(ah, bh));
  return {p, hn::Sub(hn::Mul(al, bl), hn::Sub(hn::Sub(rest, hn::Mul(al, bh)), hn::Mul(ah, bl)))};
#endif
}

HWY_INLINE Pair constant(double x) { return {hn::Set(D(), x), hn::Zero(D())}; }

HWY_INLINE Pair operator+(Pair a, Pair b) {
  const Pair s = two_sum(a.hi, b.hi);
  return fast_two_sum(s.hi, hn::Add(s.lo, hn::Add(a.lo, b.lo)));
}
HWY_INLINE Pair operator+(Pair a, double b) { return a + constant(b); }
HWY_INLINE Pair operator-(double a, Pair b) { return constant(a) + Pair{hn::Neg(b.hi), hn::Neg(b.lo)}; }

HWY_INLINE Pair operator*(Pair a, Pair b) {
  const Pair p = two_product(a.hi, b.hi);
  return fast_two_sum(p.hi, hn::Add(p.lo, hn::Add(hn::Mul(a.hi, b.lo), hn::Mul(a.lo, b.hi))));
}
HWY_INLINE Pair operator*(Pair a, double b) { return a * constant(b); }

HWY_INLINE Pair sqrt(Pair a) {
  const V s = hn::Sqrt(a.hi);
  const Pair square = two_product(s, s);
  const V rest = hn::Add(hn::Sub(hn::Sub(a.hi, square.hi), square.lo), a.lo);
  const V lo = hn::IfThenElseZero(hn::Gt(s, hn::Zero(D())), hn::Div(rest, hn::Add(s, s)));
  return fast_two_sum(s, lo);
}

HWY_INLINE Pair reciprocal(Pair a) {
  const V one = hn::Set(D(), 1.0);
  const V y = hn::Div(one, a.hi);
  const Pair p = two_product(y, a.hi);
  const V rest = hn::Sub(hn::Sub(hn::Sub(one, p.hi), p.lo), hn::Mul(y, a.lo));
  return fast_two_sum(y, hn::Mul(y, rest));
}

/// 2^k for integers |k| < 1023.
HWY_INLINE V power_of_two(V k) {
  const D d;
  const V biased = hn::Add(k, hn::Set(d, 4503599627370496.0 + 1023));  // 2^52: the integer is in the last bits
  return hn::BitCast(d, hn::ShiftLeft<52>(hn::BitCast(hn::RebindToUnsigned<D>(), biased)));
}

/// Relative error 1e-21; at most 700, and 0 below -700.
HWY_INLINE Pair exp(Pair a) {
  const D d;
  // ln 2, whose first part times k is exact.
  constexpr double ln2_high = 0.6931471805592082, ln2_low = 7.371002565167799e-13;
  constexpr int halvings = 6;
  const V x = hn::Max(hn::Min(a.hi, hn::Set(d, 700.0)), hn::Set(d, -701.0));
  const V k = hn::Round(hn::Mul(x, hn::Set(d, 1.4426950408889634)));
  const Pair whole = two_sum(x, hn::Mul(k, hn::Set(d, -ln2_high)));
  const V rest = hn::Add(whole.lo, hn::NegMulAdd(k, hn::Set(d, ln2_low), a.lo));
  const V scale = hn::Set(d, 1.0 / (1 << halvings));
  const Pair r = fast_two_sum(hn::Mul(whole.hi, scale), hn::Mul(rest, scale));
  // exp(r) - 1 for |r| < 0.0055: the terms beyond r^2 / 2 do not need more digits.
  V series = hn::Set(d, 1.0 / 40320);
  for (const double c : {1.0 / 5040, 1.0 / 720, 1.0 / 120, 1.0 / 24, 1.0 / 6}) series = hn::MulAdd(series, r.hi, hn::Set(d, c));
  const V cube = hn::Mul(hn::Mul(r.hi, r.hi), r.hi);
  const Pair square = r * r;
  const V half = hn::Set(d, 0.5);
  Pair p = r + Pair{hn::Mul(half, square.hi), hn::MulAdd(cube, series, hn::Mul(half, square.lo))};
  for (int i = 0; i < halvings; ++i) p = Pair{hn::Add(p.hi, p.hi), hn::Add(p.lo, p.lo)} + p * p;
  p = p + 1.0;
  const V power = hn::IfThenElseZero(hn::Ge(a.hi, hn::Set(d, -700.0)), power_of_two(k));
  return {hn::Mul(p.hi, power), hn::Mul(p.lo, power)};
}

/// Relative error 1e-21 of the argument.
HWY_INLINE Pair finite_log(Pair a) {
  const D d;
  const Pair safe = {hn::Max(a.hi, hn::Set(d, 1e-300)), hn::IfThenElseZero(hn::Gt(a.hi, hn::Set(d, 1e-300)), a.lo)};
  const V first = hn::Log(d, safe.hi);
  const Pair left = safe * exp({hn::Neg(first), hn::Zero(d)}) + -1.0;  // its logarithm is as large, to 1e-32
  return fast_two_sum(first, left.hi);
}

HWY_INLINE Pair positive_part(Pair a) {
  const auto positive = hn::Gt(a.hi, hn::Zero(D()));
  return {hn::IfThenElseZero(positive, a.hi), hn::IfThenElseZero(positive, a.lo)};
}

/// a is a power of two.
HWY_INLINE Pair multiply_add(double a, Pair x, double b) {
  const V scale = hn::Set(D(), a);
  return Pair{hn::Mul(scale, x.hi), hn::Mul(scale, x.lo)} + b;
}

constexpr std::size_t chunk = 32;  // 8 KiB of kernel values

HWY_INLINE Pair squared_distance(D d, const double* HWY_RESTRICT points, const Vec3& c) {
  Pair r2{hn::Zero(d), hn::Zero(d)};
  for (std::size_t k = 0; k < 3; ++k) {
    const Pair x = two_sum(hn::LoadU(d, points + k * tile_size), hn::Set(d, -c[k]));
    r2 = r2 + x * x;
  }
  return r2;
}

template <typename Phi>
HWY_INLINE void kernel_rows(const Phi& phi, const Images& images, const double* HWY_RESTRICT tile,
                            const Vec3* HWY_RESTRICT centres, std::size_t count, double* HWY_RESTRICT high,
                            double* HWY_RESTRICT low) {
  const D d;
  for (std::size_t j = 0; j < count; ++j) {
    for (std::size_t i = 0; i < tile_size; i += lanes) {
      Pair value = phi(squared_distance(d, tile + i, centres[j]));
      for (std::size_t g = 1; g < images.count; ++g) {
        const Pair image = phi(squared_distance(d, tile + i, images.at[g].of(centres[j])));
        const V sign = hn::Set(d, images.at[g].sign);
        value = value + Pair{hn::Mul(sign, image.hi), hn::Mul(sign, image.lo)};
      }
      hn::StoreU(value.hi, d, high + j * tile_size + i);
      hn::StoreU(value.lo, d, low + j * tile_size + i);
    }
  }
}

/// (sums[c][16] high, the next columns x 16 low) -= kernel values times weights, W row by row with row stride `columns`.
HWY_INLINE void subtract_product(const double* HWY_RESTRICT high, const double* HWY_RESTRICT low, std::size_t count,
                                 const double* HWY_RESTRICT W, std::size_t columns, double* HWY_RESTRICT sums) {
  const D d;
  constexpr std::size_t height = 8;  // sums of 8 points stay in registers
  double* HWY_RESTRICT rests = sums + columns * tile_size;
  for (std::size_t c = 0; c < columns; ++c) {
    for (std::size_t i = 0; i < tile_size; i += height) {
      V s[height / lanes], e[height / lanes];
      for (std::size_t v = 0; v < height / lanes; ++v) {
        s[v] = hn::LoadU(d, sums + c * tile_size + i + v * lanes);
        e[v] = hn::LoadU(d, rests + c * tile_size + i + v * lanes);
      }
      for (std::size_t j = 0; j < count; ++j) {
        const V w = hn::Set(d, -W[j * columns + c]);
        for (std::size_t v = 0; v < height / lanes; ++v) {
          const std::size_t at = j * tile_size + i + v * lanes;
          const Pair p = two_product(hn::LoadU(d, high + at), w);
          const Pair t = two_sum(s[v], p.hi);
          s[v] = t.hi;
          e[v] = hn::Add(e[v], hn::Add(t.lo, hn::MulAdd(hn::LoadU(d, low + at), w, p.lo)));
        }
      }
      for (std::size_t v = 0; v < height / lanes; ++v) {
        hn::StoreU(s[v], d, sums + c * tile_size + i + v * lanes);
        hn::StoreU(e[v], d, rests + c * tile_size + i + v * lanes);
      }
    }
  }
}

/// P: the polynomial terms of the tile's points, [term][16].
void residual_tile(const RadialKernel& kernel, const double* tile, const Vec3* centres, std::size_t count, const double* P,
                   std::size_t terms, const double* X, std::size_t columns, double* sums) {
  HWY_ALIGN double high[chunk * tile_size];
  HWY_ALIGN double low[chunk * tile_size] = {};
  subtract_product(P, low, terms, X + count * columns, columns, sums);
  const Images images(kernel.parity);
  AllKernels::visit(kernel, [&](const auto& phi) {
    for (std::size_t begin = 0; begin < count; begin += chunk) {
      const std::size_t size = HWY_MIN(chunk, count - begin);
      kernel_rows(phi, images, tile, centres + begin, size, high, low);
      subtract_product(high, low, size, X + begin * columns, columns, sums);
    }
  });
}

/// high, low: 16 values of the first centre, less those of a second one.
void column_tile(const RadialKernel& kernel, const double* tile, const Vec3* centres, std::size_t count, double* high,
                 double* low) {
  HWY_ALIGN double h[2 * tile_size];
  HWY_ALIGN double l[2 * tile_size];
  const Images images(kernel.parity);
  AllKernels::visit(kernel, [&](const auto& phi) { kernel_rows(phi, images, tile, centres, count, h, l); });
  const D d;
  for (std::size_t i = 0; i < tile_size; i += lanes) {
    Pair value{hn::Load(d, h + i), hn::Load(d, l + i)};
    if (count > 1) {
      value = value + Pair{hn::Neg(hn::Load(d, h + tile_size + i)), hn::Neg(hn::Load(d, l + tile_size + i))};
    }
    hn::StoreU(value.hi, d, high + i);
    hn::StoreU(value.lo, d, low + i);
  }
}

}  // namespace deform::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace deform {

HWY_EXPORT(residual_tile);

Eigen::MatrixXd accurate_residual(const RadialKernel& kernel, std::span<const Vec3> points, std::span<const Vec3> centres,
                                  const Eigen::MatrixXd& P, const Eigen::MatrixXd& X, const Eigen::MatrixXd& F,
                                  const RunContext& context) {
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const std::size_t columns = static_cast<std::size_t>(F.cols());
  const std::size_t terms = static_cast<std::size_t>(P.cols());
  const RowMajor coefficients = X;
  const TiledPoints tiled(points);
  Eigen::MatrixXd result(F.rows(), F.cols());
  parallel_for(context, tiled.tiles(), 1, [&](std::size_t t, std::size_t) {
    const std::size_t first = t * tile_size;
    const std::size_t count = std::min(tile_size, points.size() - first);
    std::vector<double> sums(2 * columns * tile_size, 0.0);
    for (std::size_t c = 0; c < columns; ++c) {
      for (std::size_t i = 0; i < count; ++i) {
        sums[c * tile_size + i] = F(static_cast<Eigen::Index>(first + i), static_cast<Eigen::Index>(c));
      }
    }
    std::vector<double> polynomials(terms * tile_size, 0.0);
    for (std::size_t k = 0; k < terms; ++k) {
      for (std::size_t i = 0; i < count; ++i) {
        polynomials[k * tile_size + i] = P(static_cast<Eigen::Index>(first + i), static_cast<Eigen::Index>(k));
      }
    }
    HWY_DYNAMIC_DISPATCH(residual_tile)
    (kernel, tiled.tile(t), centres.data(), centres.size(), polynomials.data(), terms, coefficients.data(), columns, sums.data());
    for (std::size_t c = 0; c < columns; ++c) {
      for (std::size_t i = 0; i < count; ++i) {
        result(static_cast<Eigen::Index>(first + i), static_cast<Eigen::Index>(c)) =
            sums[c * tile_size + i] + sums[(columns + c) * tile_size + i];
      }
    }
  });
  return result;
}

HWY_EXPORT(column_tile);

void accurate_column(const RadialKernel& kernel, const TiledPoints& points, const Vec3& centre, const Vec3* other, double* high,
                     double* low) {
  const Vec3 both[2] = {centre, other != nullptr ? *other : centre};
  for (std::size_t t = 0; t < points.tiles(); ++t) {
    HWY_DYNAMIC_DISPATCH(column_tile)
    (kernel, points.tile(t), both, other != nullptr ? 2 : 1, high + t * tile_size, low + t * tile_size);
  }
}

Eigen::MatrixXd root_square_sums(const RadialKernel& kernel, std::span<const Vec3> points, std::span<const Vec3> centres,
                                 const Eigen::MatrixXd& W, const RunContext& context) {
  const auto m = static_cast<Eigen::Index>(centres.size());
  Eigen::MatrixXd result(static_cast<Eigen::Index>(points.size()), W.cols());
  parallel_for(context, points.size(), 4, [&](std::size_t begin, std::size_t end) {
    Eigen::VectorXd row(m);
    for (std::size_t i = begin; i < end; ++i) {
      for (std::size_t j = 0; j < centres.size(); ++j) row[static_cast<Eigen::Index>(j)] = value(kernel, points[i], centres[j]);
      for (Eigen::Index c = 0; c < W.cols(); ++c) {
        result(static_cast<Eigen::Index>(i), c) = row.cwiseProduct(W.col(c).head(m)).norm();
      }
    }
  });
  context.check();
  return result;
}

}  // namespace deform
#endif
