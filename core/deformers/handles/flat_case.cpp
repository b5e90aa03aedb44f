// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/flat_case.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <span>
#include <utility>

#include "core/base/number_text.h"
#include "core/base/vectors.h"
#include "core/mesh/cells.h"

namespace deform {

namespace {

/// The vector area of a polygon.
Vec3 area_of(const Mesh& mesh, std::span<const PointId> corners) {
  Vec3 sum{};
  for (std::size_t c = 1; c + 1 < corners.size(); ++c) {
    const Vec3& first = mesh.points[corners[0]];
    sum = sum + cross(mesh.points[corners[c]] - first, mesh.points[corners[c + 1]] - first);
  }
  return sum;
}

}  // namespace

FlatCase::FlatCase(const Mesh& mesh) {
  if (!mesh.cells || mesh.cells->empty_faces.empty()) return;
  const PolyhedralCells& cells = *mesh.cells;
  std::vector<char> marked(mesh.point_count(), 0);
  Vec3 area{};
  for (std::size_t f = 0; f < cells.empty_faces.size(); ++f) {
    if (cells.empty_faces[f] == 0) continue;
    const auto corners = cells.face(f);
    if (norm(area) == 0) area = area_of(mesh, corners);
    for (const PointId id : corners) marked[id] = 1;
  }
  if (!(norm(area) > 0)) return;
  normal_ = area / norm(area);
  // To the positive side of the axis that it is closest to.
  const auto main =
      std::max_element(normal_.begin(), normal_.end(), [](double a, double b) { return std::abs(a) < std::abs(b); });
  if (*main < 0) normal_ = -1.0 * normal_;
  std::vector<double> height(mesh.point_count());
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (std::size_t i = 0; i < height.size(); ++i) {
    height[i] = dot(normal_, mesh.points[i]);
    if (marked[i] == 0) continue;
    low = std::min(low, height[i]);
    high = std::max(high, height[i]);
  }
  const double near = flatness * bounding_box(mesh.points).diagonal();
  for (std::size_t i = 0; i < height.size(); ++i) {
    if (marked[i] == 0 || height[i] - low <= near || high - height[i] <= near) continue;
    return;  // in more than two planes
  }
  if (high - low <= near) return;
  exists_ = true;
  // Partners have the same place in the plane.
  partner_.resize(mesh.point_count());
  std::iota(partner_.begin(), partner_.end(), PointId{0});
  Vec3 along{};
  along[std::abs(normal_[0]) < 0.9 ? 0 : 1] = 1;
  along = along - dot(along, normal_) * normal_;
  along = along / norm(along);
  std::vector<std::pair<double, PointId>> upper;
  for (PointId id = 0; id < mesh.point_count(); ++id) {
    if (marked[id] != 0 && high - height[id] <= near) upper.emplace_back(dot(along, mesh.points[id]), id);
  }
  std::sort(upper.begin(), upper.end());
  for (PointId id = 0; id < mesh.point_count(); ++id) {
    if (marked[id] == 0 || height[id] - low > near) continue;
    const Vec3 above = mesh.points[id] + (high - height[id]) * normal_;
    const double place = dot(along, above);
    auto at = std::lower_bound(upper.begin(), upper.end(), std::pair(place - near, PointId{0}));
    for (; at != upper.end() && at->first <= place + near; ++at) {
      if (distance(mesh.points[at->second], above) > 2 * near) continue;
      partner_[id] = at->second;
      partner_[at->second] = id;
      break;
    }
  }
}

std::string FlatCase::leaves(const Vec3& displacement, double size) const {
  const double away = std::abs(dot(normal_, displacement));
  if (!exists_ || away <= 1e-9 * size) return {};
  std::string axis;
  for (const double x : normal_) axis += (axis.empty() ? "[" : ", ") + number_digits(std::abs(x) < 1e-12 ? 0 : x);
  return "leaves the plane of a two-dimensional case (patches of type empty) by " + number_digits(away) +
         "; translate and scale along the plane, and rotate about its normal " + axis + "]";
}

std::string FlatCase::one_sided(const std::vector<PointId>& ids) const {
  if (!exists_) return {};
  for (const PointId id : ids) {
    if (partner_[id] == id || std::binary_search(ids.begin(), ids.end(), partner_[id])) continue;
    return "point " + std::to_string(id) + " is in the region, but not point " + std::to_string(partner_[id]) +
           " opposite to it; in a two-dimensional case (patches of type empty) both must move alike: select the points of both "
           "planes";
  }
  return {};
}

}  // namespace deform
