// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/detection/implied.h"

#include <algorithm>
#include <map>
#include <span>
#include <utility>

#include "core/base/vectors.h"

namespace deform::detection {

namespace {

using Primitives = std::vector<const Primitive*>;

constexpr double least_sine = 0.05;  ///< between planes that define a line

bool contains(std::span<const PointId> sorted, std::span<const PointId> ids) {
  return std::all_of(ids.begin(), ids.end(), [&](PointId p) { return std::binary_search(sorted.begin(), sorted.end(), p); });
}

/// Those that all the points belong to.
Primitives holding(const Detection& detection, std::span<const PointId> points) {
  Primitives result;
  for (const Primitive& p : detection.primitives) {
    if (contains(p.points, points)) result.push_back(&p);
  }
  return result;
}

const Primitive* first_of(const Primitives& primitives, PrimitiveKind kind, const Primitive* except = nullptr) {
  const auto place =
      std::find_if(primitives.begin(), primitives.end(), [&](const Primitive* p) { return p->kind == kind && p != except; });
  return place == primitives.end() ? nullptr : *place;
}

std::vector<std::string> names_of(const Primitive& a, const Primitive& b) { return {a.name, b.name}; }

std::vector<std::string> line_implied_by(const Primitives& on) {
  for (auto a = on.begin(); a != on.end(); ++a) {
    for (auto b = a + 1; b != on.end(); ++b) {
      const bool planes = (*a)->kind == PrimitiveKind::plane && (*b)->kind == PrimitiveKind::plane;
      if (planes && norm(cross((*a)->axis, (*b)->axis)) > least_sine) return names_of(**a, **b);
    }
  }
  return {};
}

/// Circles and arcs, by falling length.
class Rounds {
 public:
  std::vector<std::string> implied_by(const EdgeFeature& edge, const Primitives& on) {
    const Primitive* plane = first_of(on, PrimitiveKind::plane);
    const Primitive* sphere = first_of(on, PrimitiveKind::sphere);
    if (sphere != nullptr && plane != nullptr) return names_of(*plane, *sphere);
    if (sphere != nullptr) {
      if (const Primitive* other = first_of(on, PrimitiveKind::sphere, sphere)) return names_of(*sphere, *other);
    }
    const Primitive* round = first_of(on, PrimitiveKind::cylinder);
    if (round == nullptr) round = first_of(on, PrimitiveKind::cone);
    if (plane == nullptr || round == nullptr) return {};
    const auto [place, added] = square_.try_emplace({plane, round}, &edge);
    if (added) return {};
    return {plane->name, round->name, place->second->name};
  }

 private:
  /// Circles that keep a plane perpendicular to a cylinder or cone.
  std::map<std::pair<const Primitive*, const Primitive*>, const EdgeFeature*> square_;
};

}  // namespace

void find_implied(Detection& detection) {
  Rounds rounds;
  // Circles before arcs, both by falling length: the order that they have.
  for (EdgeFeature& edge : detection.edges) {
    Primitives on = holding(detection, edge.points);
    for (const Primitive* p : on) edge.lies_on.push_back(p->name);
    if (edge.constraint.empty()) continue;
    std::erase_if(on, [](const Primitive* p) { return p->constraint.empty(); });
    edge.implied_by = edge.kind == EdgeKind::line ? line_implied_by(on) : rounds.implied_by(edge, on);
  }
  for (Primitive& plane : detection.primitives) {
    if (plane.kind != PrimitiveKind::plane || plane.constraint.empty()) continue;
    for (const EdgeFeature& edge : detection.edges) {
      if (edge.kind != EdgeKind::circle || edge.constraint.empty() || !edge.implied_by.empty()) continue;
      if (edge.points.size() < plane.points.size()) continue;
      std::vector<PointId> sorted = edge.points;
      std::sort(sorted.begin(), sorted.end());
      if (contains(sorted, plane.points)) plane.implied_by = {edge.name};
    }
  }
}

}  // namespace deform::detection
