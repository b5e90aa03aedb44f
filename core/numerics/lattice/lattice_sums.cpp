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
constexpr std::size_t cubic_block = LatticeSums::block;  // points at once

/// Where component k of point i and vector d is written: to[i * point_stride + d * column_stride + k * component_stride].
struct CubicOutput {
  double* to;
  std::size_t point_stride, column_stride, component_stride;
};

}  // namespace deform

#endif

HWY_BEFORE_NAMESPACE();
namespace deform::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Points of one cell of the lattice, side by side.
using D = hn::CappedTag<double, cubic_block>;
using V = hn::Vec<D>;
constexpr std::size_t lanes = HWY_MIN(HWY_LANES(double), cubic_block);
/// So many points of a cell take no longer side by side than one by one.
constexpr std::size_t least_together = lanes / 2 + 1;

// Control points of one row, side by side.
using Row = hn::CappedTag<double, cubic_order>;
using RowVector = hn::Vec<Row>;
constexpr std::size_t row_lanes = HWY_MIN(HWY_LANES(double), cubic_order);
constexpr std::size_t row_length = 3 * cubic_order;  // the coordinates of control points side by side
constexpr std::size_t row_vectors = row_length / row_lanes;

/// Where points lie: the span along each axis, as numbers of doubles, and the place within it in [0, 1].
struct CubicPlaces {
  double span[3][cubic_block], t[3][cubic_block];
  double first[cubic_block];  ///< the number of the first control point; -1: outside
};

/// Finds the places of a block of points.
HWY_INLINE void find_places(const CubicAxis* HWY_RESTRICT axes, const double (*HWY_RESTRICT u)[cubic_block],
                            CubicPlaces& places) {
  const D d;
  for (std::size_t i = 0; i < cubic_block; i += lanes) {
    V first = hn::Zero(d);
    for (std::size_t a = 0; a < 3; ++a) {
      const V at = hn::Mul(hn::Load(d, u[a] + i), hn::Set(d, axes[a].spans));
      const V span = hn::Min(hn::Trunc(at), hn::Set(d, axes[a].spans - 1));
      hn::Store(span, d, places.span[a] + i);
      hn::Store(hn::Sub(at, span), d, places.t[a] + i);
      first = hn::MulAdd(span, hn::Set(d, static_cast<double>(axes[a].stride)), first);  // exact
    }
    const auto outside = hn::Lt(hn::Load(d, u[0] + i), hn::Zero(d));
    hn::Store(hn::IfThenElse(outside, hn::Set(d, -1.0), first), d, places.first + i);
  }
}

/// The polynomials of the span along an axis in which a point of a block lies.
HWY_INLINE const double* polynomials_at(const CubicAxis& axis, double span) {
  return axis.polynomials + 16 * static_cast<std::size_t>(span);
}

/// The values of the four functions along an axis at the place of a point within its span.
HWY_INLINE void weights_along(const double* HWY_RESTRICT c, double at, double* HWY_RESTRICT values) {
  const Row d;
  const RowVector t = hn::Set(d, at);
  for (std::size_t f = 0; f < cubic_order; f += row_lanes) {
    RowVector sum = hn::LoadU(d, c + 12 + f);
    sum = hn::MulAdd(sum, t, hn::LoadU(d, c + 8 + f));
    sum = hn::MulAdd(sum, t, hn::LoadU(d, c + 4 + f));
    hn::StoreU(hn::MulAdd(sum, t, hn::LoadU(d, c + f)), d, values + f);
  }
}

/// The same of several points in one span.
HWY_INLINE void weights_together(const double* HWY_RESTRICT c, V t, V* HWY_RESTRICT values) {
  const D d;
  for (std::size_t f = 0; f < cubic_order; ++f) {
    V sum = hn::Set(d, c[12 + f]);
    sum = hn::MulAdd(sum, t, hn::Set(d, c[8 + f]));
    sum = hn::MulAdd(sum, t, hn::Set(d, c[4 + f]));
    values[f] = hn::MulAdd(sum, t, hn::Set(d, c[f]));
  }
}

/// Rows of four control points along the first axis, added up along the second and then the third; the first axis comes last.
HWY_INLINE void sum_at(const CubicAxis* HWY_RESTRICT axes, const double* HWY_RESTRICT first,
                       const double (*HWY_RESTRICT w)[cubic_order], double* HWY_RESTRICT out, std::size_t component_stride) {
  const Row d;
  RowVector sum[row_vectors], plane[row_vectors];
  for (std::size_t v = 0; v < row_vectors; ++v) sum[v] = plane[v] = hn::Zero(d);  // which GCC does not see to be overwritten
  for (std::size_t k = 0; k < cubic_order; ++k) {
    for (std::size_t j = 0; j < cubic_order; ++j) {
      const double* const row = first + 3 * (j * axes[1].stride + k * axes[2].stride);
      const RowVector weight = hn::Set(d, w[1][j]);
      for (std::size_t v = 0; v < row_vectors; ++v) {
        const RowVector values = hn::LoadU(d, row + v * row_lanes);
        plane[v] = j == 0 ? hn::Mul(weight, values) : hn::MulAdd(weight, values, plane[v]);
      }
    }
    const RowVector weight = hn::Set(d, w[2][k]);
    for (std::size_t v = 0; v < row_vectors; ++v) {
      sum[v] = k == 0 ? hn::Mul(weight, plane[v]) : hn::MulAdd(weight, plane[v], sum[v]);
    }
  }
  double row[row_length];
  for (std::size_t v = 0; v < row_vectors; ++v) hn::StoreU(sum[v], d, row + v * row_lanes);
  for (std::size_t c = 0; c < 3; ++c) {
    out[c * component_stride] = (w[0][0] * row[c] + w[0][1] * row[3 + c]) + (w[0][2] * row[6 + c] + w[0][3] * row[9 + c]);
  }
}

/// The sums along the second axis for points of one cell, x, y and z, of the row of control points along it that begins at `at`.
HWY_INLINE void line_together(const double* HWY_RESTRICT at, std::size_t step, const V* HWY_RESTRICT w, V* HWY_RESTRICT line) {
  const D d;
  for (std::size_t c = 0; c < 3; ++c) {
    V sum = hn::Mul(w[0], hn::Set(d, at[c]));
    sum = hn::MulAdd(w[1], hn::Set(d, at[step + c]), sum);
    sum = hn::MulAdd(w[2], hn::Set(d, at[2 * step + c]), sum);
    line[c] = hn::MulAdd(w[3], hn::Set(d, at[3 * step + c]), sum);
  }
}

/// The sums along the second and third axis for points of one cell, x, y and z; `first` is the first control point of the plane.
HWY_INLINE void plane_together(const CubicAxis* HWY_RESTRICT axes, const double* HWY_RESTRICT first,
                               const V (*HWY_RESTRICT w)[cubic_order], V* HWY_RESTRICT sum) {
  const std::size_t step = 3 * axes[1].stride, next = 3 * axes[2].stride;
  const double* const end = first + cubic_order * next;
  const V* weight = w[2];
  V line[3];
  line_together(first, step, w[1], line);
  for (std::size_t c = 0; c < 3; ++c) sum[c] = hn::Mul(*weight, line[c]);
  // Up to an end in memory: when GCC unrolls this, it keeps more addresses than there are registers.
  for (const double* at = first + next; at != end; at += next) {
    ++weight;
    line_together(at, step, w[1], line);
    for (std::size_t c = 0; c < 3; ++c) sum[c] = hn::MulAdd(*weight, line[c], sum[c]);
  }
}

/// sum_at() of several points in one cell, bit for bit: x, y and z.
HWY_INLINE void sum_together(const CubicAxis* HWY_RESTRICT axes, const double* HWY_RESTRICT first,
                             const V (*HWY_RESTRICT w)[cubic_order], V* HWY_RESTRICT out) {
  V planes[cubic_order][3];
  for (std::size_t i = 0; i < cubic_order; ++i) plane_together(axes, first + 3 * i, w, planes[i]);
  for (std::size_t c = 0; c < 3; ++c) {
    out[c] = hn::Add(hn::Add(hn::Mul(w[0][0], planes[0][c]), hn::Mul(w[0][1], planes[1][c])),
                     hn::Add(hn::Mul(w[0][2], planes[2][c]), hn::Mul(w[0][3], planes[3][c])));
  }
}

/// Points of a block that lie in one cell: as many as there are lanes, the last one repeated.
void cell_sums(const CubicAxis* axes, const CubicPlaces& places, const std::size_t* points, std::size_t count,
               const Vec3* const* vectors, std::size_t columns, const CubicOutput& out) {
  const D d;
  const std::size_t leader = points[0];
  const bool in_a_row = count == lanes && points[lanes - 1] == leader + (lanes - 1);
  V w[3][cubic_order];
  for (std::size_t a = 0; a < 3; ++a) {
    HWY_ALIGN double t[lanes];
    for (std::size_t i = 0; i < lanes && !in_a_row; ++i) t[i] = places.t[a][points[HWY_MIN(i, count - 1)]];
    const V at = in_a_row ? hn::LoadU(d, places.t[a] + leader) : hn::Load(d, t);
    weights_together(polynomials_at(axes[a], places.span[a][leader]), at, w[a]);
  }
  const auto first = static_cast<std::size_t>(places.first[leader]);
  for (std::size_t c = 0; c < columns; ++c) {
    V sums[3];
    sum_together(axes, vectors[c][first].data(), w, sums);
    double* const to = out.to + c * out.column_stride;
    for (std::size_t k = 0; k < 3; ++k) {
      if (in_a_row && out.point_stride == 1) {
        hn::StoreU(sums[k], d, to + k * out.component_stride + leader);
        continue;
      }
      HWY_ALIGN double values[lanes];
      hn::Store(sums[k], d, values);
      for (std::size_t i = 0; i < count; ++i) to[points[i] * out.point_stride + k * out.component_stride] = values[i];
    }
  }
}

void point_sums(const CubicAxis* axes, const CubicPlaces& places, std::size_t point, const Vec3* const* vectors,
                std::size_t columns, const CubicOutput& out) {
  double w[3][cubic_order];
  for (std::size_t a = 0; a < 3; ++a) {
    weights_along(polynomials_at(axes[a], places.span[a][point]), places.t[a][point], w[a]);
  }
  const auto first = static_cast<std::size_t>(places.first[point]);
  for (std::size_t c = 0; c < columns; ++c) {
    sum_at(axes, vectors[c][first].data(), w, out.to + point * out.point_stride + c * out.column_stride, out.component_stride);
  }
}

/// Takes the points of a block cell after cell: neighbours in a mesh mostly share theirs, with its polynomials and control
/// points.
void cubic_sums(const CubicAxis* axes, const double (*u)[cubic_block], std::size_t count, const Vec3* const* vectors,
                std::size_t columns, const CubicOutput& out) {
  HWY_ALIGN CubicPlaces places;
  find_places(axes, u, places);
  for (std::uint32_t left = (std::uint32_t{1} << count) - 1; left != 0;) {
    std::size_t points[cubic_block], some = 0;
    const double first = places.first[hwy::Num0BitsBelowLS1Bit_Nonzero32(left)];
    for (std::size_t i = 0; i < count; ++i) {
      points[some] = i;
      some += places.first[i] == first ? 1 : 0;
    }
    for (std::size_t i = 0; i < some; ++i) left &= ~(std::uint32_t{1} << points[i]);
    if (first < 0) {
      for (std::size_t i = 0; i < some * columns * 3; ++i) {
        const std::size_t point = points[i / (3 * columns)], column = i / 3 % columns;
        out.to[point * out.point_stride + column * out.column_stride + i % 3 * out.component_stride] = 0;
      }
      continue;
    }
    std::size_t done = 0;
    for (; done + least_together <= some; done += HWY_MIN(lanes, some - done)) {
      cell_sums(axes, places, points + done, HWY_MIN(lanes, some - done), vectors, columns, out);
    }
    for (; done < some; ++done) point_sums(axes, places, points[done], vectors, columns, out);
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

template <typename At>
void LatticeSums::by_blocks(std::size_t count, const At& at, std::span<const Vec3* const> vectors, const Strides& strides,
                            double* out) const {
  const std::size_t columns = vectors.size();
  if (polynomials_[2].empty()) {
    std::vector<Vec3> sums(columns);
    for (std::size_t i = 0; i < count; ++i) {
      one_by_one(at(i), vectors, sums.data());
      for (std::size_t d = 0; d < columns; ++d) {
        for (std::size_t k = 0; k < 3; ++k) out[i * strides.point + d * strides.vector + k * strides.component] = sums[d][k];
      }
    }
    return;
  }
  const auto axes = cubic_axes();
  for (std::size_t begin = 0; begin < count; begin += block) {
    const std::size_t some = std::min(block, count - begin);
    alignas(64) double u[3][cubic_block];
    for (std::size_t i = 0; i < block; ++i) {
      const Vec3& place = at(begin + std::min(i, some - 1));
      for (std::size_t a = 0; a < 3; ++a) u[a][i] = place[a];
    }
    const CubicOutput to{out + begin * strides.point, strides.point, strides.vector, strides.component};
    HWY_DYNAMIC_DISPATCH(cubic_sums)(axes.data(), u, some, vectors.data(), columns, to);
  }
}

void LatticeSums::operator()(std::span<const Vec3> u, std::span<const Vec3* const> vectors, Vec3* out) const {
  const auto at = [&](std::size_t i) -> const Vec3& { return u[i]; };
  by_blocks(u.size(), at, vectors, {3 * vectors.size(), 3, 1}, reinterpret_cast<double*>(out));
}

void LatticeSums::operator()(std::span<const Vec3> u, std::span<const PointId> rows, std::span<const Vec3* const> vectors,
                             Vec3* out) const {
  const auto at = [&](std::size_t i) -> const Vec3& { return u[rows[i]]; };
  by_blocks(rows.size(), at, vectors, {3 * vectors.size(), 3, 1}, reinterpret_cast<double*>(out));
}

void LatticeSums::tile(std::span<const Vec3> u, std::span<const PointId> rows, std::span<const Vec3* const> vectors,
                       double* out) const {
  const auto at = [&](std::size_t i) -> const Vec3& { return u[rows[i]]; };
  by_blocks(rows.size(), at, vectors, {1, 3 * block, block}, out);
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
