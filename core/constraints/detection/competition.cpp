// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/detection/competition.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/base/parallel.h"
#include "core/constraints/detection/judgement.h"

namespace deform::detection {

namespace {

constexpr std::size_t common_fit_faces = 20000;
constexpr int sweeps = 8;

/// Angle between the normals of face and shape.
double angle_off(const Surface& surface, const Shape& shape, FaceId face) {
  return std::acos(std::min(1.0, std::abs(shape.foot(surface.centre[face]).normal.dot(surface.normal[face]))));
}

/// The misfit of a face: squared distance and angle relative to those caused by noise.
double cost(const Surface& surface, const Limits& limits, const Shape& shape, std::size_t face) {
  const auto corners = surface.corners(face);
  const double length = std::max(limits.floor, 2 * surface.noise);
  double sum = 0;
  for (const PointId p : corners) {
    const double d = shape.distance(surface.points[p]) / length;
    sum += d * d / static_cast<double>(corners.size());
  }
  if (surface.area[face] == 0) return sum;
  const double angle = angle_off(surface, shape, static_cast<FaceId>(face)) / (0.02 + surface.allowance(face) / 3);
  return sum + angle * angle;
}

/// The best of the labels at this face.
std::uint32_t winner(const Surface& surface, const Limits& limits, const Segmentation& segmentation, std::size_t face) {
  const std::uint32_t own = segmentation.labels[face];
  std::array<std::uint32_t, 8> options{};
  std::size_t count = 0;
  const auto add = [&](std::uint32_t label) {
    if (label == unlabelled || count == options.size()) return;
    if (std::find(options.begin(), options.begin() + count, label) == options.begin() + count) options[count++] = label;
  };
  add(own);
  for (const FaceId f : surface.passages(face)) add(segmentation.labels[f]);
  if (count == 0 || (count == 1 && options[0] == own)) return own;
  std::uint32_t best = unlabelled;
  double least = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const Region& region = segmentation.regions[options[i]];
    if (!fits(surface, region.shape, static_cast<FaceId>(face), limits.threshold(region.rms))) continue;
    const double c = cost(surface, limits, region.shape, face);
    if (best == unlabelled || c < least) {
      best = options[i];
      least = c;
    }
  }
  return best;
}

/// Unlabels pieces of a region that are less than a tenth of its largest one.
void drop_islands(const Surface& surface, Segmentation& segmentation) {
  auto& labels = segmentation.labels;
  std::vector<char> seen(labels.size(), 0);
  std::vector<std::vector<std::pair<double, std::vector<FaceId>>>> pieces(segmentation.regions.size());
  for (std::size_t start = 0; start < labels.size(); ++start) {
    if (seen[start] || labels[start] == unlabelled) continue;
    std::vector<FaceId> piece{static_cast<FaceId>(start)};
    seen[start] = 1;
    for (std::size_t i = 0; i < piece.size(); ++i) {
      for (const FaceId f : surface.passages(piece[i])) {
        if (seen[f] || labels[f] != labels[start]) continue;
        seen[f] = 1;
        piece.push_back(f);
      }
    }
    const double area = area_of(surface, piece);
    pieces[labels[start]].emplace_back(area, std::move(piece));
  }
  for (const auto& list : pieces) {
    double largest = 0;
    for (const auto& piece : list) largest = std::max(largest, piece.first);
    for (const auto& piece : list) {
      if (piece.first >= 0.1 * largest) continue;
      for (const FaceId f : piece.second) labels[f] = unlabelled;
    }
  }
}

template <typename Drop>
void drop_regions(Segmentation& segmentation, const Drop& drop) {
  std::vector<std::uint32_t> renumbered(segmentation.regions.size(), unlabelled);
  std::vector<Region> kept;
  for (std::size_t r = 0; r < segmentation.regions.size(); ++r) {
    if (drop(segmentation.regions[r])) continue;
    renumbered[r] = static_cast<std::uint32_t>(kept.size());
    kept.push_back(std::move(segmentation.regions[r]));
  }
  segmentation.regions = std::move(kept);
  for (auto& label : segmentation.labels) {
    if (label != unlabelled) label = renumbered[label];
  }
}

void drop_small(const Limits& limits, Segmentation& segmentation) {
  drop_regions(segmentation, [&](const Region& region) { return region.area < limits.minimum_area * (1 - 1e-9); });
}

/// Half of the area is off by less in direction.
double median_angle(const Surface& surface, const Region& region) {
  std::vector<std::pair<double, double>> angles;
  double all = 0;
  for (const FaceId f : region.faces) {
    if (surface.area[f] == 0) continue;
    angles.emplace_back(angle_off(surface, region.shape, f), surface.area[f]);
    all += surface.area[f];
  }
  std::sort(angles.begin(), angles.end());
  double sum = 0;
  for (const auto& [angle, area] : angles) {
    sum += area;
    if (sum >= all / 2) return angle;
  }
  return 0;
}

/// Smallest and largest place along the axis of `shape`.
std::pair<double, double> stretch(const Surface& surface, const Shape& shape, std::span<const FaceId> faces) {
  std::pair<double, double> range{1e300, -1e300};
  for (const FaceId f : faces) {
    for (const PointId p : surface.corners(f)) {
      const double h = (surface.points[p] - shape.point).dot(shape.axis);
      range = {std::min(range.first, h), std::max(range.second, h)};
    }
  }
  return range;
}

/// Whether regions without a common point are still one: see Primitive.
bool same_stretch(const Surface& surface, const Shape& shape, const Region& a, const Region& b) {
  if (shape.kind == PrimitiveKind::plane) return false;
  if (shape.kind == PrimitiveKind::sphere) return true;
  const auto of_a = stretch(surface, shape, a.faces), of_b = stretch(surface, shape, b.faces);
  const double common = std::min(of_a.second, of_b.second) - std::max(of_a.first, of_b.first);
  return common > 0.1 * std::min(of_a.second - of_a.first, of_b.second - of_b.first);
}

bool touch(const Surface& surface, const Region& a, const Region& b) {
  const auto points = [&](const Region& region) {
    std::vector<PointId> ids;
    for (const FaceId f : region.faces) {
      for (const PointId p : surface.corners(f)) ids.push_back(p);
    }
    std::sort(ids.begin(), ids.end());
    return ids;
  };
  const auto of_a = points(a), of_b = points(b);
  for (auto i = of_a.begin(), k = of_b.begin(); i != of_a.end() && k != of_b.end();) {
    if (*i == *k) return true;
    *i < *k ? ++i : ++k;
  }
  return false;
}

/// The two as one region when they are one.
std::optional<Region> joined(const Surface& surface, const Limits& limits, const Region& a, const Region& b) {
  if (a.shape.kind != b.shape.kind) return std::nullopt;
  const Region& large = a.area >= b.area ? a : b;
  const Region& small = a.area >= b.area ? b : a;
  if (rms_distance(large.shape, surface.data(small.faces, 200)) > 4 * limits.tolerance) return std::nullopt;
  Region both{large.shape, large.faces, a.area + b.area, 0};
  both.faces.insert(both.faces.end(), small.faces.begin(), small.faces.end());
  std::sort(both.faces.begin(), both.faces.end());
  const FitData data = surface.data(both.faces, common_fit_faces);
  const auto shape = refine(large.shape, data, Effort::full);
  if (!shape) return std::nullopt;
  both.shape = *shape;
  both.rms = rms_distance(*shape, data);
  const double alone = std::max(a.rms, b.rms);
  if (both.rms > std::max(limits.floor, 1.5 * alone)) return std::nullopt;
  if (rms_distance(*shape, surface.data(small.faces, 2000)) > std::max(limits.floor, 1.5 * alone)) return std::nullopt;
  if (rms_angle(*shape, surface.data(small.faces, 2000)) > limits.maximum_angle / 2) return std::nullopt;
  if (!touch(surface, a, b) && !same_stretch(surface, *shape, a, b)) return std::nullopt;
  return both;
}

}  // namespace

void refit(const Surface& surface, Segmentation& segmentation, std::span<const char> changed, const RunContext& context) {
  for (std::size_t r = 0; r < segmentation.regions.size(); ++r) {
    if (changed[r]) segmentation.regions[r].faces.clear();
  }
  for (std::size_t f = 0; f < segmentation.labels.size(); ++f) {
    const std::uint32_t label = segmentation.labels[f];
    if (label != unlabelled && changed[label]) segmentation.regions[label].faces.push_back(static_cast<FaceId>(f));
  }
  parallel_for(context, segmentation.regions.size(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t r = begin; r < end; ++r) {
      if (!changed[r]) continue;
      Region& region = segmentation.regions[r];
      region.area = area_of(surface, region.faces);
      const FitData data = surface.data(region.faces, common_fit_faces);
      if (data.corners.empty()) continue;
      if (const auto shape = refine(region.shape, data, Effort::full)) region.shape = *shape;
      region.rms = rms_distance(region.shape, data);
    }
  });
}

void compete(const Surface& surface, const Limits& limits, Segmentation& segmentation, const RunContext& context) {
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    context.check();
    std::vector<char> changed(segmentation.regions.size(), sweep == 0 ? 1 : 0);
    bool any = false;
    for (std::size_t f = 0; f < segmentation.labels.size(); ++f) {
      const std::uint32_t own = segmentation.labels[f], best = winner(surface, limits, segmentation, f);
      if (best == own) continue;
      any = true;
      if (own != unlabelled) changed[own] = 1;
      if (best != unlabelled) changed[best] = 1;
      segmentation.labels[f] = best;
    }
    refit(surface, segmentation, changed, context);
    if (!any) break;
  }
  drop_islands(surface, segmentation);
  refit(surface, segmentation, std::vector<char>(segmentation.regions.size(), 1), context);
  drop_small(limits, segmentation);
}

void trim(const Surface& surface, const Limits& limits, Segmentation& segmentation, const RunContext& context) {
  auto& labels = segmentation.labels;
  std::vector<char> changed(segmentation.regions.size(), 0);
  for (std::uint32_t r = 0; r < segmentation.regions.size(); ++r) {
    Region& region = segmentation.regions[r];
    if (region.rms > 3 * surface.noise + limits.tolerance / 40) continue;  // facets are off everywhere
    const double direction = 2.5 * median_angle(surface, region), distance = 2 * region.rms + 0.1 * limits.floor;
    const auto off = [&](FaceId f) {
      if (surface.area[f] == 0) return false;
      const double angle = angle_off(surface, region.shape, f);
      if (angle <= std::max(direction, 0.5 * surface.allowance(f)) + 0.005) return false;
      const auto corners = surface.corners(f);
      return std::any_of(corners.begin(), corners.end(),
                         [&](PointId p) { return std::abs(region.shape.distance(surface.points[p])) > distance; });
    };
    // Row by row from the rim, two at most: more would not have been taken for tangential.
    for (int row = 0; row < 2; ++row) {
      std::vector<FaceId> gone;
      for (const FaceId f : region.faces) {
        const auto neighbours = surface.neighbours(f);
        const bool at_rim =
            std::any_of(neighbours.begin(), neighbours.end(), [&](const Neighbour& n) { return labels[n.face] != r; });
        if (labels[f] == r && at_rim && off(f)) gone.push_back(f);
      }
      for (const FaceId f : gone) labels[f] = unlabelled;
      if (gone.empty()) break;
      changed[r] = 1;
    }
  }
  refit(surface, segmentation, changed, context);
  drop_small(limits, segmentation);
}

void drop_accidental(const Surface& surface, Segmentation& segmentation) {
  drop_regions(segmentation, [&](const Region& region) { return !evident(surface, region); });
}

void join_regions(const Surface& surface, const Limits& limits, Segmentation& segmentation) {
  auto& regions = segmentation.regions;
  for (std::size_t a = 0; a < regions.size(); ++a) {
    for (std::size_t b = a + 1; b < regions.size(); ++b) {
      auto both = joined(surface, limits, regions[a], regions[b]);
      if (!both) continue;
      regions[a] = std::move(*both);
      regions.erase(regions.begin() + static_cast<std::ptrdiff_t>(b));
      for (auto& label : segmentation.labels) {
        if (label == unlabelled) continue;
        if (label == b) label = static_cast<std::uint32_t>(a);
        if (label > b) --label;
      }
      b = a;  // once more against all others
    }
  }
}

}  // namespace deform::detection
