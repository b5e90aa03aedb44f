// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/spaces/body_reach.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <queue>
#include <utility>

#include "core/base/parallel.h"
#include "core/base/vectors.h"

namespace deform {

namespace {

constexpr double link_length = 1.9;  // spacings
constexpr double known_ways = 1.5;   // radii
// How much longer than a straight one a way along links may be, in a body without slots.
constexpr double allowance = 1, detour = 1.1;  // spacings, and times the length
constexpr double least_outside = 1e-6;         // of the diagonal: cracks between faces that touch
constexpr std::size_t looked_at = 12, starts = 4;
constexpr double alike = 1e-9;  // squared distances that differ by less count as equal: two points are as far from their mean
constexpr std::size_t links_of_sample = 40, ways_of_sample = 300;  // more than there are on average
constexpr double no_way = std::numeric_limits<double>::infinity();

}  // namespace

BodyReach::BodyReach(const Mesh& mesh, std::span<const Vec3> points, std::vector<Vec3> samples, const DensePoints& dense,
                     double radius, const RunContext& context)
    : samples_(std::move(samples)), crossings_(mesh, points), winding_(mesh, points), ways_(samples_.size()) {
  if (samples_.size() < 2) return;
  const PointTree tree(samples_);
  std::vector<double> nearest(samples_.size());
  for (std::size_t i = 0; i < samples_.size(); ++i) nearest[i] = std::sqrt(tree.kth_square(samples_[i], 2));
  const auto middle = nearest.begin() + static_cast<std::ptrdiff_t>(nearest.size() / 2);
  std::nth_element(nearest.begin(), middle, nearest.end());
  spacing_ = *middle;
  place_anchors(dense, context);
  find_links(tree, context);
  find_parts();
  find_ways(tree, radius, context);
}

/// Samples lie on faces, so that a segment between them may run along these, and rounding would decide whether it is outside: the
/// dense point in the body nearest to the mean of those of a sample takes its place, the first of two that are as near. A few
/// samples are the nearest of none.
void BodyReach::place_anchors(const DensePoints& dense, const RunContext& context) {
  anchors_ = samples_;
  const std::span<const Vec3> inside = std::span(dense.points).subspan(dense.surface);
  const std::vector<std::uint32_t> owner = nearest_points(PointTree(samples_), inside, context);
  std::vector<Vec3> means(samples_.size(), Vec3{});
  std::vector<double> counts(samples_.size(), 0), nearest(samples_.size(), no_way);
  for (std::size_t i = 0; i < owner.size(); ++i) {
    means[owner[i]] = means[owner[i]] + inside[i];
    counts[owner[i]] += 1;
  }
  for (std::size_t i = 0; i < owner.size(); ++i) {
    const std::uint32_t j = owner[i];
    const double square = squared_distance(inside[i], means[j] / counts[j]);
    if (square >= (1 - alike) * nearest[j]) continue;
    nearest[j] = square;
    anchors_[j] = inside[i];
  }
  if (inside.empty()) return;
  const PointTree tree(inside);
  std::vector<double> scratch;
  for (std::size_t j = 0; j < samples_.size(); ++j) {
    if (counts[j] == 0) anchors_[j] = nearest_seen(tree, samples_[j], scratch);
  }
}

/// The nearest of the dense points that a sample on a face sees, or itself if it sees none of those next to it.
Vec3 BodyReach::nearest_seen(const PointTree& inside, const Vec3& sample, std::vector<double>& scratch) const {
  std::vector<PointTree::Near> near;
  inside.within(sample, inside.kth_square(sample, std::min(looked_at, inside.points().size())), near);
  std::sort(near.begin(), near.end(), [](const auto& a, const auto& b) { return a.square < b.square; });
  for (const auto& found : near) {
    const Vec3& x = inside.points()[found.point];
    if (within_body(sample, x, scratch)) return x;
  }
  return sample;
}

/// Whether no part of a segment is outside. Faces that it crosses within the body (parts that overlap or touch) do not count.
bool BodyReach::within_body(const Vec3& a, const Vec3& b, std::vector<double>& scratch) const {
  crossings_.along(a, b, scratch);
  if (scratch.empty()) return true;
  const double size = distance(a, b);
  scratch.push_back(1);
  double last = 0;
  for (const double t : scratch) {
    if ((t - last) * size > least_outside && std::abs(winding_.at(lerp(a, b, 0.5 * (last + t)))) <= 0.5) return false;
    last = t;
  }
  return true;
}

void BodyReach::find_links(const PointTree& tree, const RunContext& context) {
  links_.resize(samples_.size());
  blocked_.assign(samples_.size(), 0);
  const double square = link_length * link_length * spacing_ * spacing_;
  parallel_for(context, samples_.size(), 64, [&](std::size_t begin, std::size_t end) {
    std::vector<PointTree::Near> near;
    std::vector<double> scratch;
    for (std::size_t i = begin; i < end; ++i) {
      tree.within(samples_[i], square, near);
      for (const auto& found : near) {
        const std::size_t low = std::min<std::size_t>(i, found.point), high = std::max<std::size_t>(i, found.point);
        if (low == high) continue;
        if (within_body(anchors_[low], anchors_[high], scratch)) {
          links_[i].push_back(found.point);
        } else {
          blocked_[i] = 1;
        }
      }
      std::sort(links_[i].begin(), links_[i].end());
    }
  });
}

void BodyReach::find_parts() {
  constexpr auto none = std::numeric_limits<std::uint32_t>::max();
  part_.assign(samples_.size(), none);
  std::vector<std::uint32_t> waiting;
  std::uint32_t parts = 0;
  for (std::uint32_t i = 0; i < samples_.size(); ++i) {
    if (part_[i] != none) continue;
    part_[i] = parts;
    waiting.push_back(i);
    while (!waiting.empty()) {
      const std::uint32_t j = waiting.back();
      waiting.pop_back();
      for (const std::uint32_t next : links_[j]) {
        if (part_[next] != none) continue;
        part_[next] = parts;
        waiting.push_back(next);
      }
    }
    ++parts;
  }
}

/// Dijkstra's method, up to a limit, from every sample near which a link is blocked. Only those with a way that is too long keep
/// their ways.
void BodyReach::find_ways(const PointTree& tree, double radius, const RunContext& context) {
  std::vector<char> is_cut(samples_.size(), 0);
  parallel_for(context, samples_.size(), 64, [&](std::size_t begin, std::size_t end) {
    std::vector<double> length(samples_.size(), no_way);
    std::vector<std::uint32_t> reached;
    std::vector<PointTree::Near> near;
    using Entry = std::pair<double, std::uint32_t>;
    std::priority_queue<Entry, std::vector<Entry>, std::greater<>> waiting;
    const double most = detour * known_ways * radius + 2 * allowance * spacing_, looked = radius + spacing_;
    for (std::size_t i = begin; i < end; ++i) {
      context.check();
      tree.within(samples_[i], looked * looked, near);
      if (std::none_of(near.begin(), near.end(), [&](const auto& found) { return blocked_[found.point] != 0; })) continue;
      const auto start = static_cast<std::uint32_t>(i);
      length[i] = 0;
      reached.assign(1, start);
      waiting.push({0, start});
      while (!waiting.empty()) {
        const auto [at, j] = waiting.top();
        waiting.pop();
        if (at > length[j]) continue;
        for (const std::uint32_t next : links_[j]) {
          const double there = at + distance(samples_[j], samples_[next]);
          if (there > most || there >= length[next]) continue;
          if (length[next] == no_way) reached.push_back(next);
          length[next] = there;
          waiting.push({there, next});
        }
      }
      for (const auto& found : near) {
        if (part_[found.point] != part_[i]) continue;
        if (counted(length[found.point]) > std::sqrt(found.square)) is_cut[i] = 1;
      }
      if (is_cut[i] != 0) {
        std::sort(reached.begin(), reached.end());
        for (const std::uint32_t j : reached) ways_[i].push_back({j, length[j]});
      }
      for (const std::uint32_t j : reached) length[j] = no_way;
    }
  });
  cut_ = static_cast<std::size_t>(std::count(is_cut.begin(), is_cut.end(), 1));
}

double BodyReach::counted(double way) const { return (way - allowance * spacing_) / detour; }

double BodyReach::way(std::uint32_t from, std::uint32_t to) const {
  const std::vector<Way>& ways = ways_[from];
  if (ways.empty()) return distance(samples_[from], samples_[to]);
  const auto found = std::lower_bound(ways.begin(), ways.end(), to, [](const Way& way, std::uint32_t j) { return way.to < j; });
  return found != ways.end() && found->to == to ? found->length : no_way;
}

bool BodyReach::lengthens(const Vec3& /*x*/, std::span<const PointTree::Near> near) const {
  return cut_ > 0 && std::any_of(near.begin(), near.end(), [&](const auto& found) { return !ways_[found.point].empty(); });
}

void BodyReach::lengthen(const Vec3& x, std::span<const PointTree::Near> near, std::vector<double>& distances) const {
  distances.clear();
  for (const auto& found : near) distances.push_back(std::sqrt(found.square));
  std::vector<std::uint32_t> order(near.size());
  std::iota(order.begin(), order.end(), 0U);
  const std::size_t closest = std::min(looked_at, near.size());
  std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(closest), order.end(),
                    [&](std::uint32_t a, std::uint32_t b) {
                      return near[a].square != near[b].square ? near[a].square < near[b].square : near[a].point < near[b].point;
                    });
  std::vector<std::pair<std::uint32_t, double>> from;  // samples that x sees, and how far they are
  std::vector<double> scratch;
  for (std::size_t i = 0; i < closest && from.size() < starts; ++i) {
    const std::uint32_t sample = near[order[i]].point;
    if (within_body(x, anchors_[sample], scratch)) from.emplace_back(sample, distances[order[i]]);
  }
  if (from.empty()) return;
  for (std::size_t i = 0; i < near.size(); ++i) {
    if (part_[near[i].point] != part_[from.front().first]) continue;
    double least = no_way;
    for (const auto& [start, to_start] : from) least = std::min(least, to_start + way(start, near[i].point));
    distances[i] = std::max(distances[i], counted(least));
  }
}

std::size_t BodyReach::bytes_for(std::size_t triangles, std::size_t samples) {
  const std::size_t of_sample = 3 * sizeof(Vec3) + links_of_sample * sizeof(std::uint32_t) + ways_of_sample * sizeof(Way) + 64;
  return SegmentCrossings::bytes_for(triangles) + WindingNumber::bytes_for(triangles) + samples * of_sample;
}

}  // namespace deform
