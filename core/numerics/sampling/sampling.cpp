// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/sampling/sampling.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <queue>
#include <utility>

#include "core/base/parallel.h"
#include "core/numerics/sampling/farthest_points.h"
#include "core/numerics/sampling/point_tree.h"

namespace deform {

namespace {

constexpr std::size_t samples_per_range = 4096;

/// The generator splitmix64 as a function of its position: any thread can compute any number of the sequence.
std::uint64_t mixed(std::uint64_t seed, std::uint64_t position) {
  std::uint64_t x = seed + (position + 1) * 0x9e3779b97f4a7c15u;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
  return x ^ (x >> 31);
}

double even(std::uint64_t seed, std::uint64_t position) {  // 0 <= . < 1
  return static_cast<double>(mixed(seed, position) >> 11) * 0x1p-53;
}

/// Distances to the points taken so far, and which is largest.
class Farthest {
 public:
  Farthest(std::span<const Vec3> points, std::span<const Vec3> taken, const RunContext& context)
      : tree_(points), squares_(points.size(), std::numeric_limits<double>::infinity()) {
    if (!taken.empty()) {
      const PointTree others(taken);
      parallel_for(context, points.size(), samples_per_range, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) squares_[i] = others.nearest(points[i]).square;
      });
      for (std::size_t i = 0; i < points.size(); ++i) waiting_.push({squares_[i], i});
    }
  }

  /// No point can come closer to the new one than to those before unless it lies within its distance to those.
  void take(std::size_t point, bool first) {
    const double reach = squares_[point];
    tree_.within(tree_.points()[point], reach, near_);
    for (const PointTree::Near& near : near_) squares_[near.point] = std::min(squares_[near.point], near.square);
    squares_[point] = 0;
    if (!first) return;
    for (std::size_t i = 0; i < squares_.size(); ++i) waiting_.push({squares_[i], i});
  }

  /// The first of those with the largest distance; size() when all are at 0.
  std::size_t next() {
    while (!waiting_.empty()) {
      const Waiting top = waiting_.top();
      const double now = squares_[top.point];
      if (now == top.square) return now > 0 ? top.point : squares_.size();
      waiting_.pop();  // has come closer since it was put there
      if (now > 0) waiting_.push({now, top.point});
    }
    return squares_.size();
  }

 private:
  struct Waiting {
    double square;
    std::size_t point;
    bool operator<(const Waiting& other) const { return square != other.square ? square < other.square : point > other.point; }
  };

  PointTree tree_;
  std::vector<double> squares_;
  std::priority_queue<Waiting> waiting_;
  std::vector<PointTree::Near> near_;
};

std::vector<Vec3> chosen(std::span<const Vec3> points, const std::vector<std::uint32_t>& which) {
  std::vector<Vec3> places;
  places.reserve(which.size());
  for (const std::uint32_t i : which) places.push_back(points[i]);
  return places;
}

/// One step of Lloyd's method. Samples nearest to no dense point stay.
void relax(std::vector<Vec3>& samples, const DensePoints& dense, double surface_weight, const RunContext& context) {
  const std::vector<std::uint32_t> owner = nearest_points(PointTree(samples), dense.points, context);
  std::vector<Vec3> sums(samples.size(), Vec3{});
  std::vector<double> weights(samples.size(), 0.0);
  for (std::size_t i = 0; i < owner.size(); ++i) {  // one after the other: the sums must not depend on the threads
    const double weight = i < dense.surface ? surface_weight : 1.0;
    for (std::size_t k = 0; k < 3; ++k) sums[owner[i]][k] += weight * dense.points[i][k];
    weights[owner[i]] += weight;
  }
  for (std::size_t j = 0; j < samples.size(); ++j) {
    if (weights[j] > 0) samples[j] = {sums[j][0] / weights[j], sums[j][1] / weights[j], sums[j][2] / weights[j]};
  }
}

}  // namespace

UniformSamples sample_uniformly(const Pieces& pieces, std::size_t count, std::uint64_t seed, const RunContext& context) {
  std::vector<double> until(pieces.count());  // the total measure up to and with a piece
  parallel_for(context, until.size(), samples_per_range, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) until[i] = pieces.measure(i);
  });
  double total = 0;
  for (double& value : until) {
    total += value;
    value = total;
  }
  UniformSamples samples;
  samples.measure = total;
  if (!(total > 0) || count == 0) return samples;
  samples.points.resize(count);
  parallel_for(context, count, samples_per_range, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const double at = (static_cast<double>(i) + even(seed, 4 * i)) / static_cast<double>(count) * total;
      // The first whose end lies beyond has a measure; rounding at the very end must not leave the pieces.
      auto piece = std::upper_bound(until.begin(), until.end(), at);
      if (piece == until.end()) piece = std::lower_bound(until.begin(), until.end(), total);
      samples.points[i] = pieces.place(static_cast<std::size_t>(piece - until.begin()),
                                       {even(seed, 4 * i + 1), even(seed, 4 * i + 2), even(seed, 4 * i + 3)});
    }
  });
  return samples;
}

Vec3 place_in_triangle(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& random) {
  double s = random[0], t = random[1];
  if (s + t > 1) {
    s = 1 - s;
    t = 1 - t;
  }
  Vec3 x;
  for (std::size_t k = 0; k < 3; ++k) x[k] = a[k] + s * (b[k] - a[k]) + t * (c[k] - a[k]);
  return x;
}

Vec3 place_in_tetrahedron(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d, Vec3 random) {
  auto& [s, t, u] = random;
  if (s + t > 1) {
    s = 1 - s;
    t = 1 - t;
  }
  if (t + u > 1) {
    const double was = u;
    u = 1 - s - t;
    t = 1 - was;
  } else if (s + t + u > 1) {
    const double was = u;
    u = s + t + u - 1;
    s = 1 - t - was;
  }
  Vec3 x;
  for (std::size_t k = 0; k < 3; ++k) x[k] = a[k] + s * (b[k] - a[k]) + t * (c[k] - a[k]) + u * (d[k] - a[k]);
  return x;
}

std::vector<std::uint32_t> fast_farthest_points(std::span<const Vec3> points, std::size_t count, std::span<const Vec3> taken,
                                                const RunContext& context) {
  std::vector<std::uint32_t> order;
  count = std::min(count, points.size());
  if (count == 0) return order;
  Farthest farthest(points, taken, context);
  if (taken.empty()) {
    const std::size_t first = PointCover(points).farthest();
    farthest.take(first, true);
    order.push_back(static_cast<std::uint32_t>(first));
  }
  while (order.size() < count) {
    if (order.size() % 64 == 0) context.check();
    const std::size_t next = farthest.next();
    if (next == points.size()) break;
    farthest.take(next, false);
    order.push_back(static_cast<std::uint32_t>(next));
  }
  return order;
}

Samples spread_samples(const DensePoints& dense, const SampleOptions& options, const RunContext& context) {
  const std::span<const Vec3> all(dense.points);
  const std::span<const Vec3> surface = all.first(dense.surface), volume = all.subspan(dense.surface);
  Samples samples;
  samples.points = chosen(surface, fast_farthest_points(surface, options.surface, {}, context));
  samples.surface = samples.points.size();
  const std::vector<Vec3> inner = chosen(volume, fast_farthest_points(volume, options.volume, samples.points, context));
  samples.points.insert(samples.points.end(), inner.begin(), inner.end());
  for (int step = 0; step < options.relaxation_steps; ++step) {
    context.check();
    relax(samples.points, dense, options.surface_weight, context);
  }
  return samples;
}

std::vector<double> voronoi_shares(std::span<const Vec3> samples, const DensePoints& dense, const RunContext& context) {
  std::vector<double> shares(samples.size(), 0.0);
  if (samples.empty() || dense.points.empty()) return shares;
  const bool flat = dense.in_volume() == 0;
  const std::size_t first = flat ? 0 : dense.surface, count = flat ? dense.surface : dense.in_volume();
  const double share = (flat ? dense.area : dense.volume) / static_cast<double>(count);
  const auto owner = nearest_points(PointTree(samples), std::span(dense.points).subspan(first), context);
  for (const std::uint32_t j : owner) shares[j] += share;
  return shares;
}

}  // namespace deform
