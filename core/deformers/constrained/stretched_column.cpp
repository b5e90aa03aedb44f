// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/constrained/stretched_column.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/base/vectors.h"
#include "core/constraints/flat_projection.h"
#include "core/constraints/matched_shape.h"

namespace deform {

namespace {

constexpr double most_stretch = 1e8;  // beyond, differences of functions have no digits

}  // namespace

StretchedColumn::StretchedColumn(Corners corners, std::span<const Vec3> rest, const Vec3* flat) : corners_(std::move(corners)) {
  std::vector<char> above(rest.size());
  for (std::size_t i = corners_.sides; i < corners_.places.size(); ++i) above[corners_.places[i]] = 1;
  for (std::uint32_t i = 0; i < rest.size(); ++i) {
    if (above[i] == 0) plain_.push_back(i);
  }
  scales_.assign(corners_.places.size() / corners_.sides - 1, 1.0);
  const double width = std::sqrt(length(area(rest, 0)));
  rest_heights_ = heights(rest);
  for (std::size_t layer = 0; layer < layers(); ++layer) {
    const double height = std::abs(rest_heights_[layer]);
    if (height * most_stretch > width) scales_[layer] = std::max(1.0, width / height);
  }
  rest_ = stretched(rest);
  projection_ = matched_projection(rest_, Match::rigid);
  if (flat != nullptr) projection_ = std::make_shared<const FlatProjection>(projection_, *flat, rest_);
}

Vec3 StretchedColumn::mean_edge(std::span<const Vec3> x, std::size_t layer) const {
  Vec3 sum{};
  for (std::size_t c = 0; c < corners_.sides; ++c) sum = sum + (x[corner(layer + 1, c)] - x[corner(layer, c)]);
  return sum / static_cast<double>(corners_.sides);
}

/// The vector area of the face of a level.
Vec3 StretchedColumn::area(std::span<const Vec3> x, std::size_t level) const {
  const Vec3 first = x[corner(level, 0)];
  Vec3 sum{};
  for (std::size_t c = 1; c + 1 < corners_.sides; ++c) {
    sum = sum + cross(x[corner(level, c)] - first, x[corner(level, c + 1)] - first);
  }
  return 0.5 * sum;
}

std::vector<double> StretchedColumn::heights(std::span<const Vec3> x) const {
  std::vector<double> result;
  Vec3 below = area(x, 0);
  for (std::size_t layer = 0; layer < layers(); ++layer) {
    const Vec3 above = area(x, layer + 1), normal = below + above;
    const double size = length(normal);
    result.push_back(size > 0 ? dot(mean_edge(x, layer), normal) / size : 0);
    below = above;
  }
  return result;
}

std::vector<double> StretchedColumn::relative_heights(std::span<const Vec3> x) const {
  std::vector<double> result = heights(x);
  for (std::size_t layer = 0; layer < layers(); ++layer) {
    result[layer] = rest_heights_[layer] != 0 ? result[layer] / rest_heights_[layer] : 1;
  }
  return result;
}

std::vector<Vec3> StretchedColumn::stretched(std::span<const Vec3> x) const {
  std::vector<Vec3> y(x.begin(), x.end());
  for (std::size_t layer = 0; layer < layers(); ++layer) {
    for (std::size_t c = 0; c < corners_.sides; ++c) {
      y[corner(layer + 1, c)] = x[corner(0, c)] + scales_[layer] * (x[corner(layer + 1, c)] - x[corner(layer, c)]);
    }
  }
  return y;
}

std::vector<Vec3> StretchedColumn::unstretched(std::span<const Vec3> y) const {
  std::vector<Vec3> x(y.begin(), y.end());
  for (std::size_t layer = 0; layer < layers(); ++layer) {
    for (std::size_t c = 0; c < corners_.sides; ++c) {
      x[corner(layer + 1, c)] = x[corner(layer, c)] + (y[corner(layer + 1, c)] - y[corner(0, c)]) / scales_[layer];
    }
  }
  return x;
}

std::vector<Vec3> StretchedColumn::adjoint(std::span<const Vec3> y) const {
  std::vector<Vec3> x(y.size(), Vec3{});
  for_each_row([&](std::uint32_t row, std::span<const Entry> entries) {
    for (const auto& [place, factor] : entries) x[place] = x[place] + factor * y[row];
  });
  return x;
}

}  // namespace deform
