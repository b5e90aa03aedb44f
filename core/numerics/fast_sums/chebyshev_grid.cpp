// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/fast_sums/chebyshev_grid.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/numerics/kernels/tiles.h"

namespace deform {

namespace {

constexpr std::size_t most_order = 32;

constexpr std::array<std::array<std::uint8_t, 3>, 6> orders{{{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}}};

}  // namespace

const std::array<std::uint8_t, 3>& ChebyshevGrid::axis_order(std::size_t p) { return orders[p]; }

ChebyshevGrid::ChebyshevGrid(int order) : order_(static_cast<std::size_t>(order)) {
  const auto p = order_;
  for (std::size_t i = 0; i < p; ++i) {
    roots_.push_back(-std::cos(std::numbers::pi * (static_cast<double>(i) + 0.5) / static_cast<double>(p)));
  }
  chebyshev_.resize(p * p);
  for (std::size_t i = 0; i < p; ++i) {
    const double angle = std::numbers::pi * (static_cast<double>(p - 1 - i) + 0.5) / static_cast<double>(p);
    for (std::size_t k = 0; k < p; ++k) chebyshev_[i * p + k] = std::cos(static_cast<double>(k) * angle);
  }
  for (std::size_t side = 0; side < 2; ++side) {
    transfer_[side].resize(p * p);
    std::vector<double> at(p);
    for (std::size_t j = 0; j < p; ++j) {
      values(0.5 * roots_[j] + (side == 0 ? -0.5 : 0.5), at.data());
      for (std::size_t i = 0; i < p; ++i) transfer_[side][i * p + j] = at[i];
    }
  }
  for (std::size_t s = 0; s < symmetries_.size(); ++s) {
    symmetries_[s].resize(nodes());
    const auto& axes = orders[s / 8];
    for (std::size_t node = 0; node < nodes(); ++node) {
      const std::array<std::size_t, 3> from{node / (p * p), node / p % p, node % p};
      std::array<std::size_t, 3> to;
      for (std::size_t k = 0; k < 3; ++k) {
        to[k] = from[axes[k]];
        if (s & (std::size_t{4} >> k)) to[k] = p - 1 - to[k];
      }
      symmetries_[s][node] = static_cast<std::uint16_t>((to[0] * p + to[1]) * p + to[2]);
    }
  }
}

std::vector<Vec3> ChebyshevGrid::nodes(const Vec3& centre, double half) const {
  std::vector<Vec3> result;
  result.reserve(nodes());
  for (const double x : roots_) {
    for (const double y : roots_) {
      for (const double z : roots_) result.push_back({centre[0] + half * x, centre[1] + half * y, centre[2] + half * z});
    }
  }
  return result;
}

void ChebyshevGrid::values(double x, double* out) const {
  // S_i(x) = 1/p + 2/p sum over k of T_k(x_i) T_k(x).
  double T[most_order];
  T[0] = 0.5;
  T[1] = x;
  double before = 1, last = x;
  for (std::size_t k = 2; k < order_; ++k) {
    T[k] = 2 * x * last - before;
    before = last;
    last = T[k];
  }
  for (std::size_t i = 0; i < order_; ++i) {
    double sum = 0;
    for (std::size_t k = 0; k < order_; ++k) sum += chebyshev_[i * order_ + k] * T[k];
    out[i] = 2 * sum / static_cast<double>(order_);
  }
}

void ChebyshevGrid::tile_values(const double* tile, const Vec3& centre, double half, double* out) const {
  double axis[3][most_order * tile_size];
  double at[most_order];
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t i = 0; i < tile_size; ++i) {
      values((tile[k * tile_size + i] - centre[k]) / half, at);
      for (std::size_t a = 0; a < order_; ++a) axis[k][a * tile_size + i] = at[a];
    }
  }
  double xy[tile_size];
  for (std::size_t a = 0; a < order_; ++a) {
    for (std::size_t b = 0; b < order_; ++b) {
      for (std::size_t i = 0; i < tile_size; ++i) xy[i] = axis[0][a * tile_size + i] * axis[1][b * tile_size + i];
      for (std::size_t c = 0; c < order_; ++c, out += tile_size) {
        for (std::size_t i = 0; i < tile_size; ++i) out[i] = xy[i] * axis[2][c * tile_size + i];
      }
    }
  }
}

void ChebyshevGrid::along_axes(unsigned octant, bool up, const double* from, std::size_t columns, double* to) const {
  const std::size_t p = order_;
  std::vector<double> a(from, from + nodes() * columns), b(nodes() * columns);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::vector<double>& matrix = transfer_[octant >> (2 - axis) & 1];
    // As a three-way array: outer x p x inner.
    const std::size_t inner = (axis == 0 ? p * p : axis == 1 ? p : 1) * columns;
    const std::size_t outer = nodes() * columns / (inner * p);
    std::fill(b.begin(), b.end(), 0.0);
    for (std::size_t o = 0; o < outer; ++o) {
      for (std::size_t i = 0; i < p; ++i) {
        double* result = b.data() + (o * p + i) * inner;
        for (std::size_t j = 0; j < p; ++j) {
          const double factor = up ? matrix[i * p + j] : matrix[j * p + i];
          const double* source = a.data() + (o * p + j) * inner;
          for (std::size_t k = 0; k < inner; ++k) result[k] += factor * source[k];
        }
      }
    }
    a.swap(b);
  }
  for (std::size_t k = 0; k < a.size(); ++k) to[k] += a[k];
}

void ChebyshevGrid::to_parent(unsigned octant, const double* child, std::size_t columns, double* parent) const {
  along_axes(octant, true, child, columns, parent);
}

void ChebyshevGrid::to_child(unsigned octant, const double* parent, std::size_t columns, double* child) const {
  along_axes(octant, false, parent, columns, child);
}

}  // namespace deform
