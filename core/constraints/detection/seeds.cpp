// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/detection/seeds.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/base/parallel.h"
#include "core/constraints/detection/judgement.h"

namespace deform::detection {

namespace {

constexpr std::size_t seed_fit_faces = 400;
constexpr int draws = 16;                       ///< random samples of one neighbourhood and kind
constexpr std::size_t seed_judging_faces = 64;  ///< faces of the neighbourhood that judge them

/// The shape that most of the faces agree with, from random samples of a few of them; at most `draws` tries.
std::optional<Shape> consensus(const Surface& surface, const Limits& limits, PrimitiveKind kind, std::span<const FaceId> faces,
                               Random& random) {
  const std::size_t sample_size = kind == PrimitiveKind::plane ? 3 : kind == PrimitiveKind::cone ? 6 : 4;
  if (faces.size() < 2 * sample_size) return std::nullopt;
  std::optional<Shape> best;
  double best_score = 0;
  std::vector<FaceId> sample(sample_size);
  const std::size_t stride = std::max<std::size_t>(1, faces.size() / seed_judging_faces);
  for (int draw = 0; draw < draws; ++draw) {
    for (FaceId& f : sample) f = faces[random.below(faces.size())];
    const auto shape = guess(kind, surface.data(sample, sample_size));
    if (!shape) continue;
    // Every face counts the more the closer it is.
    double score = 0;
    for (std::size_t i = 0; i < faces.size(); i += stride) {
      if (!fits(surface, *shape, faces[i], limits.tolerance)) continue;
      const double d = shape->distance(surface.points[surface.corners(faces[i])[0]]) / limits.tolerance;
      score += surface.area[faces[i]] * (1 - d * d);
    }
    if (score > best_score) {
      best_score = score;
      best = shape;
    }
  }
  return best;
}

/// Whether one of the regions of this kind already holds nearly all of these faces.
bool held(std::span<const Region> regions, PrimitiveKind kind, const Surface& surface, const Limits& limits,
          std::span<const FaceId> faces) {
  return std::any_of(regions.begin(), regions.end(), [&](const Region& region) {
    if (region.shape.kind != kind) return false;
    const double threshold = limits.threshold(region.rms);
    std::size_t inside = 0;
    for (const FaceId f : faces) inside += fits(surface, region.shape, f, threshold) ? 1 : 0;
    return inside * 10 >= faces.size() * 9;
  });
}

/// Grown from a first shape, brought down to the simplest kind, judged.
void add_grown(const Surface& surface, const Limits& limits, Growth& growth, const Shape& shape, std::span<const FaceId> start,
               std::span<const std::uint32_t> labels, std::vector<Region>& regions) {
  auto region = growth.converged(shape, start, labels);
  if (!region || region->area < limits.minimum_area) return;
  const Region simple = simplest(surface, limits, *region);
  if (simple.shape.kind != region->shape.kind) {
    region = growth.converged(simple.shape, simple.faces, labels);
    if (!region || region->area < limits.minimum_area) return;
  }
  if (convincing(surface, limits, *region)) regions.push_back(std::move(*region));
}

}  // namespace

std::uint64_t Random::next() {
  std::uint64_t z = (state_ += 0x9e3779b97f4a7c15ull);
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
  return z ^ (z >> 31);
}

std::size_t Random::below(std::size_t count) { return static_cast<std::size_t>(unit() * static_cast<double>(count)); }

double Random::unit() { return static_cast<double>(next() >> 11) * 0x1p-53; }

Patches smooth_patches(const Surface& surface, double angle) {
  Patches patches;
  std::vector<char> seen(surface.face_count(), 0);
  for (std::size_t start = 0; start < surface.face_count(); ++start) {
    if (seen[start] || surface.area[start] == 0) continue;
    seen[start] = 1;
    patches.begin.push_back(patches.order.size());
    patches.order.push_back(static_cast<FaceId>(start));
    for (std::size_t i = patches.begin.back(); i < patches.order.size(); ++i) {
      const FaceId f = patches.order[i];
      for (const Neighbour& n : surface.neighbours(f)) {
        if (seen[n.face] || surface.area[n.face] == 0) continue;
        if (n.angle > angle + std::min(0.3, surface.allowance(f) + surface.allowance(n.face))) continue;
        seen[n.face] = 1;
        patches.order.push_back(n.face);
      }
    }
  }
  patches.begin.push_back(patches.order.size());
  return patches;
}

std::vector<Region> grown_from_patches(const Surface& surface, const Limits& limits, GrowthPool& pool,
                                       std::span<const std::uint32_t> labels, const RunContext& context) {
  std::vector<std::vector<FaceId>> starts;
  for (const double part : {1.0, 0.5, 0.25}) {
    const Patches patches = smooth_patches(surface, part * limits.maximum_angle);
    for (std::size_t p = 0; p + 1 < patches.begin.size(); ++p) {
      const std::span<const FaceId> patch(patches.order.data() + patches.begin[p], patches.begin[p + 1] - patches.begin[p]);
      if (area_of(surface, patch) < limits.minimum_area) continue;
      const bool again = std::any_of(starts.begin(), starts.end(), [&](const std::vector<FaceId>& other) {
        return other.size() == patch.size() && other.front() == patch.front();
      });
      if (!again) starts.emplace_back(patch.begin(), patch.end());
    }
    context.check();
  }
  std::vector<std::vector<Region>> found(starts.size());
  parallel_for(context, starts.size(), 1, [&](std::size_t begin, std::size_t end) {
    pool.with([&](Growth& growth) {
      for (std::size_t i = begin; i < end; ++i) {
        const FitData data = surface.data(starts[i], seed_fit_faces);
        for (const PrimitiveKind kind : limits.kinds) {
          const auto shape = fitted(kind, data, Effort::full);
          // Whole patches only: parts of them are for the seeds.
          if (!shape || rms_distance(*shape, data) > limits.tolerance) continue;
          add_grown(surface, limits, growth, *shape, starts[i], labels, found[i]);
          if (!found[i].empty() && found[i].back().area > 0.99 * area_of(surface, starts[i])) break;
        }
      }
    });
  });
  std::vector<Region> regions;
  for (auto& list : found) std::move(list.begin(), list.end(), std::back_inserter(regions));
  std::stable_sort(regions.begin(), regions.end(), [](const Region& a, const Region& b) { return a.area > b.area; });
  return regions;
}

std::vector<double> curvature_unevenness(const Surface& surface) {
  std::vector<double> bending(surface.face_count(), 0), uneven(surface.face_count(), 0);
  for (std::size_t f = 0; f < surface.face_count(); ++f) {
    double turned = 0, area = surface.area[f];
    for (const Neighbour& n : surface.neighbours(f)) {
      turned += n.angle * (surface.points[n.to] - surface.points[n.from]).norm();
      area += surface.area[n.face] / 3;
    }
    bending[f] = area > 0 ? turned / area : 0;
  }
  for (std::size_t f = 0; f < surface.face_count(); ++f) {
    for (const Neighbour& n : surface.neighbours(f)) uneven[f] = std::max(uneven[f], std::abs(bending[n.face] - bending[f]));
  }
  return uneven;
}

std::vector<FaceId> spread_seeds(const Surface& surface, const Limits& limits, const Patches& patches,
                                 std::span<const double> unevenness, std::span<const std::uint32_t> labels, std::uint64_t sweep) {
  constexpr std::size_t most = 20000;
  std::vector<FaceId> open;
  double area = 0;
  for (const FaceId f : patches.order) {
    if (labels[f] != unlabelled) continue;
    open.push_back(f);
    area += surface.area[f];
  }
  std::vector<FaceId> seeds;
  const double step = std::max(limits.minimum_area / 2, area / static_cast<double>(most));
  if (area < limits.minimum_area) return seeds;
  Random random(limits.seed, sweep);
  double reached = 0, next = step * random.unit();
  std::size_t begin = 0;
  for (std::size_t i = 0; i < open.size(); ++i) {
    reached += surface.area[open[i]];
    if (reached < next && i + 1 < open.size()) continue;
    FaceId best = open[i];
    for (int draw = 0; draw < 8; ++draw) {
      const FaceId other = open[begin + random.below(i + 1 - begin)];
      if (unevenness[other] < unevenness[best]) best = other;
    }
    seeds.push_back(best);
    begin = i + 1;
    while (next <= reached) next += step;
  }
  return seeds;
}

std::vector<Region> grown_from_seed(const Surface& surface, const Limits& limits, Growth& growth, FaceId seed,
                                    std::span<const std::uint32_t> labels) {
  struct Scale {
    double area;  ///< of the smallest primitive
    std::size_t faces;
  };
  constexpr std::array<Scale, 4> scales{{{0, 1}, {0.15, 6}, {0.6, 16}, {2.5, 40}}};
  std::vector<Region> regions;
  Random random(limits.seed, 0x5eed0000ull + seed);
  std::size_t last = 0;
  for (const Scale& scale : scales) {
    const auto faces = growth.neighbourhood(seed, scale.area * limits.minimum_area, scale.faces, labels);
    if (faces.size() == last) break;
    last = faces.size();
    const FitData data = surface.data(faces, seed_fit_faces);
    for (const PrimitiveKind kind : limits.kinds) {
      if (kind != PrimitiveKind::plane && faces.size() < 4) continue;
      if (held(regions, kind, surface, limits, faces)) continue;
      const auto plain = fitted(kind, data, Effort::quick);
      const double rms = plain ? rms_distance(*plain, data) : limits.tolerance;
      if (plain && rms < limits.tolerance) add_grown(surface, limits, growth, *plain, faces, labels, regions);
      if (rms <= 2 * limits.floor) break;  // nothing in these surroundings disagrees, and the kinds that follow would not either
      const auto robust = consensus(surface, limits, kind, faces, random);
      if (robust) add_grown(surface, limits, growth, *robust, faces, labels, regions);
    }
  }
  return regions;
}

}  // namespace deform::detection
