// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/lattice/lattice_sums.h"

#include <algorithm>

#include "core/base/vectors.h"

// Compiled once per instruction set; the calls below pick the best one at run time. Scalable vectors cannot be stored in arrays.
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_RVV)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/numerics/lattice/lattice_sums.cpp"
#include <hwy/foreach_target.h>  // must come before highway.h

#include <hwy/highway.h>

#ifndef DEFORM_CUBIC_AXIS
#define DEFORM_CUBIC_AXIS

namespace deform {

/// An axis as the code of each instruction set sees it.
struct CubicAxis {
  const double* polynomials;  ///< 16 per span
  double spans;
  std::size_t stride;  ///< from one control point along the axis to the next
};

constexpr std::size_t cubic_order = 4;

}  // namespace deform

#endif

HWY_BEFORE_NAMESPACE();
namespace deform::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using D = hn::CappedTag<double, cubic_order>;
using V = hn::Vec<D>;
constexpr std::size_t lanes = HWY_MIN(HWY_LANES(double), cubic_order);
constexpr std::size_t row_length = 3 * cubic_order;  // the coordinates of control points side by side
constexpr std::size_t row_vectors = row_length / lanes;

/// The values of the four functions at u, and the first of their control points.
HWY_INLINE std::size_t weights_along(const CubicAxis& axis, double u, double* HWY_RESTRICT values) {
  const double at = u * axis.spans;
  const double span = HWY_MIN(static_cast<double>(static_cast<std::int64_t>(at)), axis.spans - 1);
  const auto first = static_cast<std::size_t>(span);
  const double* const c = axis.polynomials + 16 * first;
  const D d;
  const V t = hn::Set(d, at - span);
  for (std::size_t f = 0; f < cubic_order; f += lanes) {
    V sum = hn::LoadU(d, c + 12 + f);
    sum = hn::MulAdd(sum, t, hn::LoadU(d, c + 8 + f));
    sum = hn::MulAdd(sum, t, hn::LoadU(d, c + 4 + f));
    hn::StoreU(hn::MulAdd(sum, t, hn::LoadU(d, c + f)), d, values + f);
  }
  return first * axis.stride;
}

/// Rows of four control points along the first axis, added up along the second and then the third; the first axis comes last.
HWY_INLINE Vec3 sum_at(const CubicAxis* HWY_RESTRICT axes, const double* HWY_RESTRICT first,
                       const double (*HWY_RESTRICT w)[cubic_order]) {
  const D d;
  V sum[row_vectors], plane[row_vectors];
  for (std::size_t v = 0; v < row_vectors; ++v) sum[v] = plane[v] = hn::Zero(d);  // which GCC does not see to be overwritten
  for (std::size_t k = 0; k < cubic_order; ++k) {
    for (std::size_t j = 0; j < cubic_order; ++j) {
      const double* const row = first + 3 * (j * axes[1].stride + k * axes[2].stride);
      const V weight = hn::Set(d, w[1][j]);
      for (std::size_t v = 0; v < row_vectors; ++v) {
        const V values = hn::LoadU(d, row + v * lanes);
        plane[v] = j == 0 ? hn::Mul(weight, values) : hn::MulAdd(weight, values, plane[v]);
      }
    }
    const V weight = hn::Set(d, w[2][k]);
    for (std::size_t v = 0; v < row_vectors; ++v) {
      sum[v] = k == 0 ? hn::Mul(weight, plane[v]) : hn::MulAdd(weight, plane[v], sum[v]);
    }
  }
  double row[row_length];
  for (std::size_t v = 0; v < row_vectors; ++v) hn::StoreU(sum[v], d, row + v * lanes);
  Vec3 result;
  for (std::size_t c = 0; c < 3; ++c)
    result[c] = (w[0][0] * row[c] + w[0][1] * row[3 + c]) + (w[0][2] * row[6 + c] + w[0][3] * row[9 + c]);
  return result;
}

/// The weights of a point, and the first of its control points.
struct CubicPoint {
  double weights[3][cubic_order];
  std::size_t first;
  bool outside;
};

void cubic_sums(const CubicAxis* axes, const Vec3* u, const PointId* rows, std::size_t count, const Vec3* const* vectors,
                std::size_t columns, Vec3* out) {
  constexpr std::size_t most = 16;
  CubicPoint points[most];
  for (std::size_t begin = 0; begin < count; begin += most) {
    const std::size_t some = HWY_MIN(most, count - begin);
    // Of several points first, since each waits for its place in the lattice.
    for (std::size_t i = 0; i < some; ++i) {
      const Vec3& at = u[rows == nullptr ? begin + i : rows[begin + i]];
      CubicPoint& point = points[i];
      point.outside = at[0] < 0;
      point.first = 0;
      if (point.outside) continue;
      for (std::size_t a = 0; a < 3; ++a) point.first += weights_along(axes[a], at[a], point.weights[a]);
    }
    // Neighbours share control points, which stay near for one vector after the other.
    for (std::size_t c = 0; c < columns; ++c) {
      for (std::size_t i = 0; i < some; ++i) {
        out[(begin + i) * columns + c] =
            points[i].outside ? Vec3{} : sum_at(axes, vectors[c][points[i].first].data(), points[i].weights);
      }
    }
  }
}

}  // namespace deform::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace deform {

HWY_EXPORT(cubic_sums);

namespace {

/// Taylor coefficients at the begin of each span.
std::vector<double> cubic_polynomials(const SplineAxis& axis) {
  std::vector<double> result;
  const auto spans = static_cast<double>(axis.spans());
  for (std::size_t span = 0; span < axis.spans(); ++span) {
    double factor = 1;  // of the length of a span, over the factorial
    for (std::size_t power = 0; power < cubic_order; ++power) {
      if (power > 0) factor /= spans * static_cast<double>(power);
      std::array<double, SplineAxis::most_order> values{};
      axis.evaluate(span, axis.knot(span + axis.degree()), power, values.data());
      for (std::size_t f = 0; f < cubic_order; ++f) result.push_back(values[f] * factor);
    }
  }
  return result;
}

}  // namespace

LatticeSums::LatticeSums(const Lattice& lattice) : lattice_(lattice) {
  for (std::size_t a = 0; a < 3; ++a) {
    if (lattice.axis(a).order() != cubic_order) return;
  }
  for (std::size_t a = 0; a < 3; ++a) polynomials_[a] = cubic_polynomials(lattice.axis(a));
}

std::array<CubicAxis, 3> LatticeSums::cubic_axes() const {
  std::array<CubicAxis, 3> axes{};
  for (std::size_t a = 0, stride = 1; a < 3; ++a) {
    axes[a] = {polynomials_[a].data(), static_cast<double>(lattice_.axis(a).spans()), stride};
    stride *= lattice_.axis(a).size();
  }
  return axes;
}

void LatticeSums::operator()(std::span<const Vec3> u, std::span<const Vec3* const> vectors, Vec3* out) const {
  if (polynomials_[2].empty()) {
    for (std::size_t i = 0; i < u.size(); ++i) one_by_one(u[i], vectors, out + i * vectors.size());
    return;
  }
  const auto axes = cubic_axes();
  HWY_DYNAMIC_DISPATCH(cubic_sums)(axes.data(), u.data(), nullptr, u.size(), vectors.data(), vectors.size(), out);
}

void LatticeSums::operator()(std::span<const Vec3> u, std::span<const PointId> rows, std::span<const Vec3* const> vectors,
                             Vec3* out) const {
  if (polynomials_[2].empty()) {
    for (std::size_t i = 0; i < rows.size(); ++i) one_by_one(u[rows[i]], vectors, out + i * vectors.size());
    return;
  }
  const auto axes = cubic_axes();
  HWY_DYNAMIC_DISPATCH(cubic_sums)(axes.data(), u.data(), rows.data(), rows.size(), vectors.data(), vectors.size(), out);
}

void LatticeSums::one_by_one(const Vec3& u, std::span<const Vec3* const> vectors, Vec3* out) const {
  if (u[0] < 0) {
    std::fill_n(out, vectors.size(), Vec3{});
    return;
  }
  const LatticeWeights at = lattice_.weights(u);
  const std::size_t l = lattice_.axis(0).order(), m = lattice_.axis(1).order(), n = lattice_.axis(2).order();
  for (std::size_t d = 0; d < vectors.size(); ++d) {
    Vec3 sum{};
    for (std::size_t k = 0; k < n; ++k) {
      Vec3 plane{};
      for (std::size_t j = 0; j < m; ++j) {
        const Vec3* const values = vectors[d] + lattice_.number(at.first[0], at.first[1] + j, at.first[2] + k);
        Vec3 line{};
        for (std::size_t i = 0; i < l; ++i) line = line + at.along[0][i] * values[i];
        plane = plane + at.along[1][j] * line;
      }
      sum = sum + at.along[2][k] * plane;
    }
    out[d] = sum;
  }
}

}  // namespace deform

#endif  // HWY_ONCE
