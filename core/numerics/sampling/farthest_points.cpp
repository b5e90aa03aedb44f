// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/sampling/farthest_points.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/vectors.h"

namespace deform {

namespace {

std::size_t first_largest(const std::vector<double>& values, double alike) {
  const auto largest = std::max_element(values.begin(), values.end());
  if (alike == 0 || largest == values.end()) return static_cast<std::size_t>(largest - values.begin());
  const double least = (1 - alike) * *largest;
  return static_cast<std::size_t>(std::find_if(values.begin(), largest, [&](double v) { return v >= least; }) - values.begin());
}

}  // namespace

PointCover::PointCover(std::span<const Vec3> points)
    : points_(points), squares_(points.size(), std::numeric_limits<double>::infinity()) {}

void PointCover::take(std::size_t point) {
  const Vec3 place = points_[point];
  for (std::size_t i = 0; i < points_.size(); ++i) squares_[i] = std::min(squares_[i], squared_distance(points_[i], place));
  taken_.push_back(static_cast<std::uint32_t>(point));
}

double PointCover::distance(std::size_t point) const { return std::sqrt(squares_[point]); }

std::size_t PointCover::farthest(double alike) const {
  if (!taken_.empty()) return first_largest(squares_, alike);
  Vec3 mean{};
  for (const Vec3& x : points_) {
    for (std::size_t k = 0; k < 3; ++k) mean[k] += x[k] / static_cast<double>(points_.size());
  }
  std::vector<double> squares;
  for (const Vec3& x : points_) squares.push_back(squared_distance(x, mean));
  return first_largest(squares, alike);
}

std::vector<std::uint32_t> farthest_point_order(std::span<const Vec3> points, std::size_t count, double alike, double least) {
  PointCover cover(points);
  while (cover.taken().size() < std::min(count, points.size())) {
    const std::size_t next = cover.farthest(alike);
    if (cover.distance(next) <= least) break;
    cover.take(next);
  }
  return cover.taken();
}

}  // namespace deform
