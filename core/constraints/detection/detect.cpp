// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/detection/detect.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/parallel.h"
#include "core/constraints/constraint.h"
#include "core/constraints/detection/clusters.h"
#include "core/constraints/detection/competition.h"
#include "core/constraints/detection/edges.h"
#include "core/constraints/detection/implied.h"
#include "core/constraints/detection/judgement.h"
#include "core/constraints/detection/names.h"
#include "core/constraints/detection/seeds.h"

namespace deform {

namespace {

using namespace detection;

constexpr double default_minimum_area = 0.01;
constexpr double default_maximum_angle = 0.6;
constexpr double default_tolerance = 1e-3;
constexpr double least_floor = 1e-5;          ///< rounding of coordinates in files with six or seven digits
constexpr std::size_t batch = 32;             ///< seeds that grow before the best of them are taken
constexpr double clusters_in_smallest = 256;  ///< of faces, in the smallest primitive

void check_range(const char* field, double value, double below, const char* meaning) {
  if (value >= 0 && value < below) return;  // false for NaN
  throw Error(ErrorCode::invalid_argument,
              std::string("detection.") + field + ": " + number_digits(value) + " is not " + meaning);
}

Limits limits_of(const DetectOptions& options, Surface& surface, const RunContext& context) {
  Limits limits;
  limits.seed = options.seed;
  limits.maximum_angle = options.maximum_angle > 0 ? options.maximum_angle : default_maximum_angle;
  surface.noise = estimated_noise(surface, limits.maximum_angle, context);
  surface.find_passages(limits.maximum_angle);
  const double automatic = std::max(default_tolerance, 5 * surface.noise);
  limits.tolerance = options.tolerance > 0 ? options.tolerance / surface.size : automatic;
  limits.floor = std::min(limits.tolerance, std::max(least_floor, 3 * surface.noise));
  limits.minimum_area = (options.minimum_area > 0 ? options.minimum_area : default_minimum_area) * surface.total_area;
  limits.kinds = options.kinds;
  if (limits.kinds.empty()) {
    limits.kinds = {PrimitiveKind::plane, PrimitiveKind::cylinder, PrimitiveKind::sphere, PrimitiveKind::cone};
  }
  std::sort(limits.kinds.begin(), limits.kinds.end());
  limits.kinds.erase(std::unique(limits.kinds.begin(), limits.kinds.end()), limits.kinds.end());
  return limits;
}

/// The faces of a region over clusters that are not labelled and fit; none when they cannot be enough.
std::vector<FaceId> open_faces(const Surface& surface, const Limits& limits, const Clusters& clusters, const Region& region,
                               std::span<const std::uint32_t> labels) {
  double area = 0;
  for (const FaceId c : region.faces) area += labels[clusters.faces(c)[0]] == unlabelled ? clusters.surface.area[c] : 0;
  std::vector<FaceId> open;
  if (area < limits.minimum_area) return open;
  const double threshold = limits.threshold(region.rms);
  for (const FaceId c : region.faces) {
    for (const FaceId f : clusters.faces(c)) {
      if (labels[f] == unlabelled && fits(surface, region.shape, f, threshold)) open.push_back(f);
    }
  }
  return open;
}

/// Takes regions, the largest first, each as far as earlier ones left its faces. Those over clusters grow once more, over faces.
void accept(const Surface& surface, const Limits& limits, const Clusters* clusters, std::vector<Region>& found, GrowthPool& pool,
            Segmentation& segmentation) {
  auto& labels = segmentation.labels;
  for (Region& region : found) {
    std::vector<FaceId> open;
    if (clusters) {
      open = open_faces(surface, limits, *clusters, region, labels);
    } else {
      std::copy_if(region.faces.begin(), region.faces.end(), std::back_inserter(open),
                   [&](FaceId f) { return labels[f] == unlabelled; });
      if (area_of(surface, open) < limits.minimum_area) continue;
    }
    if (open.empty()) continue;
    if (clusters || open.size() < region.faces.size()) {
      std::optional<Region> rest;
      pool.with([&](Growth& growth) { rest = growth.converged(region.shape, open, labels); });
      if (!rest || rest->area < limits.minimum_area || !convincing(surface, limits, *rest)) continue;
      if (simplest(surface, limits, *rest).shape.kind != rest->shape.kind) continue;
      region = std::move(*rest);
    }
    for (const FaceId f : region.faces) labels[f] = static_cast<std::uint32_t>(segmentation.regions.size());
    segmentation.regions.push_back(std::move(region));
  }
}

void grow_from_seeds(const Surface& surface, const Limits& limits, GrowthPool& pool, Segmentation& segmentation,
                     const RunContext& context) {
  const Patches patches = smooth_patches(surface, limits.maximum_angle / 4);
  const std::vector<double> unevenness = curvature_unevenness(surface);
  const Clusters clusters(surface, limits.minimum_area / clusters_in_smallest);
  const bool fine = 2 * clusters.count() <= surface.face_count();  // else there is little to gain
  const Surface& ground = fine ? clusters.surface : surface;
  GrowthPool ground_pool(ground, limits);
  // Over clusters one more is cheap, and of shapes that only one seed in a few finds (nearly flat ones) fewer are missed.
  const std::uint64_t sweeps = fine ? 3 : 2;
  for (std::uint64_t sweep = 0; sweep < sweeps; ++sweep) {
    const auto seeds = spread_seeds(surface, limits, patches, unevenness, segmentation.labels, sweep);
    std::size_t next = 0;
    while (next < seeds.size()) {
      const auto labels = fine ? clusters.labels(segmentation.labels) : segmentation.labels;
      std::vector<FaceId> group;
      for (; next < seeds.size() && group.size() < batch; ++next) {
        const FaceId seed = fine ? clusters.cluster_of[seeds[next]] : seeds[next];
        if (labels[seed] == unlabelled) group.push_back(seed);
      }
      std::vector<std::vector<Region>> found(group.size());
      parallel_for(context, group.size(), 1, [&](std::size_t begin, std::size_t end) {
        ground_pool.with([&](Growth& growth) {
          for (std::size_t i = begin; i < end; ++i) found[i] = grown_from_seed(ground, limits, growth, group[i], labels);
        });
      });
      std::vector<Region> regions;
      for (auto& list : found) std::move(list.begin(), list.end(), std::back_inserter(regions));
      std::stable_sort(regions.begin(), regions.end(), [](const Region& a, const Region& b) { return a.area > b.area; });
      accept(surface, limits, fine ? &clusters : nullptr, regions, pool, segmentation);
      context.progress("detect", (static_cast<double>(sweep) + static_cast<double>(next) / static_cast<double>(seeds.size())) /
                                     static_cast<double>(sweeps));
    }
  }
}

Vec3 plain(const Vector3d& v) { return {v[0], v[1], v[2]}; }

/// The sign of a direction by its largest part, so that it does not depend on how it was found.
Vector3d turned(const Vector3d& axis) {
  Eigen::Index largest = 0;
  axis.cwiseAbs().maxCoeff(&largest);
  return axis[largest] < 0 ? Vector3d(-axis) : axis;
}

Primitive primitive_of(const Mesh& mesh, const std::vector<std::uint64_t>& offsets, const Surface& surface,
                       const Region& region) {
  const Shape& shape = region.shape;
  const auto place = [&](const Vector3d& p) { return plain(surface.middle + surface.size * p); };
  Primitive primitive;
  primitive.kind = shape.kind;
  primitive.point = place(shape.kind == PrimitiveKind::cone ? shape.apex() : shape.point);
  if (shape.kind == PrimitiveKind::plane) {
    // Outwards, as most faces look.
    Vector3d normal = Vector3d::Zero();
    for (const FaceId f : region.faces) normal += surface.area[f] * surface.normal[f];
    primitive.axis = plain(normal.dot(shape.axis) < 0 ? Vector3d(-shape.axis) : shape.axis);
  }
  if (shape.kind == PrimitiveKind::cylinder) primitive.axis = plain(turned(shape.axis));
  if (shape.kind == PrimitiveKind::cone) {
    primitive.axis = plain(shape.axis);
    primitive.half_angle = shape.angle;
  }
  if (shape.kind == PrimitiveKind::cylinder || shape.kind == PrimitiveKind::sphere)
    primitive.radius = surface.size * shape.radius;
  primitive.faces = region.faces;
  std::sort(primitive.faces.begin(), primitive.faces.end());
  for (const FaceId f : primitive.faces) {
    primitive.points.insert(primitive.points.end(), mesh.face_points.begin() + static_cast<std::ptrdiff_t>(offsets[f]),
                            mesh.face_points.begin() + static_cast<std::ptrdiff_t>(offsets[f + 1]));
  }
  std::sort(primitive.points.begin(), primitive.points.end());
  primitive.points.erase(std::unique(primitive.points.begin(), primitive.points.end()), primitive.points.end());
  double squares = 0;
  for (const PointId p : primitive.points) {
    const double d = surface.size * std::abs(shape.distance(surface.points[p]));
    squares += d * d;
    primitive.max = std::max(primitive.max, d);
  }
  primitive.rms = std::sqrt(squares / static_cast<double>(primitive.points.size()));
  primitive.area = region.area * surface.size * surface.size;
  return primitive;
}

/// By kind and falling area; areas that are equal up to rounding by the first face.
void sort(std::vector<Primitive>& primitives) {
  std::sort(primitives.begin(), primitives.end(), [](const Primitive& a, const Primitive& b) {
    return a.kind != b.kind ? a.kind < b.kind : a.area != b.area ? a.area > b.area : a.faces[0] < b.faces[0];
  });
  for (auto begin = primitives.begin(), end = begin; begin != primitives.end(); begin = end) {
    while (end != primitives.end() && end->kind == begin->kind && end->area >= begin->area * (1 - 1e-6)) ++end;
    std::sort(begin, end, [](const Primitive& a, const Primitive& b) { return a.faces[0] < b.faces[0]; });
  }
}

/// The kind of constraint for a set of this number of points, or an empty string if it needs more.
std::string constraint_for(const ConstraintKind& kind, std::size_t points) {
  return points < least_points(kind) ? std::string() : std::string(kind_name(kind));
}

ConstraintKind constraint_of(PrimitiveKind kind) {
  switch (kind) {
    case PrimitiveKind::plane:
      return Planar{};
    case PrimitiveKind::cylinder:
      return Cylindrical{};
    case PrimitiveKind::sphere:
      return Spherical{};
    case PrimitiveKind::cone:
      break;
  }
  return Conical{};
}

ConstraintKind constraint_of(EdgeKind kind) {
  if (kind == EdgeKind::line) return Straight{};
  return Circular{};
}

}  // namespace

void DetectOptions::validate() const {
  check_range("tolerance", tolerance, 1e300, "finite and at least 0");
  check_range("minimum_area", minimum_area, 1, "at least 0 and below 1");
  check_range("maximum_angle", maximum_angle, std::numbers::pi / 2, "at least 0 and below pi / 2");
}

Detection detect(const Mesh& mesh, const DetectOptions& options, const RunContext& context) {
  options.validate();
  Surface surface(mesh, context);
  const Limits limits = limits_of(options, surface, context);
  Segmentation segmentation;
  segmentation.labels.assign(surface.face_count(), unlabelled);
  GrowthPool pool(surface, limits);
  auto patches = grown_from_patches(surface, limits, pool, segmentation.labels, context);
  accept(surface, limits, nullptr, patches, pool, segmentation);
  grow_from_seeds(surface, limits, pool, segmentation, context);
  compete(surface, limits, segmentation, context);
  for (Region& region : segmentation.regions) region = simplest(surface, limits, region);
  join_regions(surface, limits, segmentation);
  compete(surface, limits, segmentation, context);
  trim(surface, limits, segmentation, context);
  drop_accidental(surface, segmentation);

  Detection result;
  result.size = surface.size;
  result.noise = surface.noise * surface.size;
  result.area = surface.model_area;
  result.tolerance = limits.tolerance * surface.size;
  result.minimum_area = limits.minimum_area / surface.total_area;
  result.maximum_angle = limits.maximum_angle;
  for (const Region& region : segmentation.regions) {
    result.primitives.push_back(primitive_of(mesh, surface.offsets, surface, region));
    result.coverage += region.area / surface.total_area;
  }
  sort(result.primitives);
  result.edges = feature_edges(mesh, surface, limits, segmentation.labels);
  set_names(result);
  for (Primitive& p : result.primitives) p.constraint = constraint_for(constraint_of(p.kind), p.points.size());
  for (EdgeFeature& e : result.edges) e.constraint = constraint_for(constraint_of(e.kind), e.points.size());
  find_implied(result);
  std::size_t without_area = 0;
  for (const double a : surface.area) without_area += a == 0 ? 1 : 0;
  if (without_area > 0) result.notes.push_back(std::to_string(without_area) + " faces have no area");
  context.progress("detect", 1);
  return result;
}

std::string_view to_string(PrimitiveKind kind) {
  switch (kind) {
    case PrimitiveKind::plane:
      return "plane";
    case PrimitiveKind::cylinder:
      return "cylinder";
    case PrimitiveKind::sphere:
      return "sphere";
    case PrimitiveKind::cone:
      return "cone";
  }
  return "";
}

std::string_view to_string(EdgeKind kind) {
  switch (kind) {
    case EdgeKind::line:
      return "line";
    case EdgeKind::circle:
      return "circle";
    case EdgeKind::arc:
      return "arc";
  }
  return "";
}

std::string_view constraint_kind(PrimitiveKind kind) { return kind_name(constraint_of(kind)); }

std::string_view constraint_kind(EdgeKind kind) { return kind_name(constraint_of(kind)); }

}  // namespace deform
