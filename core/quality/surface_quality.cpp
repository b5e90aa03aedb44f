// SPDX-License-Identifier: Apache-2.0
#include "core/quality/surface_quality.h"

#include <algorithm>
#include <limits>
#include <numbers>
#include <numeric>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/mesh/inspect.h"
#include "core/quality/infinity.h"
#include "core/quality/polygon.h"
#include "core/quality/summary.h"

namespace deform {

namespace {

using namespace quality;

constexpr std::size_t surface_elements_per_range = 4096;
constexpr double pi = std::numbers::pi;

/// 2 r / R of a triangle = 16 A^2 / ((a + b + c) a b c).
double radius_ratio(const Vec3& x, const Vec3& y, const Vec3& z) {
  const double a = length(y - x), b = length(z - y), c = length(x - z);
  const double twice_area = length(cross(y - x, z - x)), below = (a + b + c) * a * b * c;
  return below > 0 ? std::min(1.0, 4 * twice_area * twice_area / below) : 0;
}

/// That of the triangles around the middle of a regular polygon: 8 sin(A/2) sin(B/2) sin(C/2).
double regular_ratio(std::size_t corners) {
  const double at_middle = 2 * pi / static_cast<double>(corners), at_corner = (pi - at_middle) / 2;
  return 8 * std::sin(at_middle / 2) * std::sin(at_corner / 2) * std::sin(at_corner / 2);
}

struct Measured {
  double quality = 0, area = 0;
  double least_angle = std::numeric_limits<double>::infinity(), largest_angle = -1;  // degrees; as they are: no angle
  bool repeats = false;
};

class Surface {
 public:
  explicit Surface(const Mesh& mesh) : mesh_(mesh), offsets_(mesh.face_offsets()) {}

  std::span<const PointId> corners(std::size_t f) const {
    return std::span(mesh_.face_points).subspan(offsets_[f], mesh_.face_sizes[f]);
  }

  double face_quality(std::size_t f) const {
    const auto at = corners(f);
    if (at.size() < 3) return 0;
    const auto& p = mesh_.points;
    if (at.size() == 3) return radius_ratio(p[at[0]], p[at[1]], p[at[2]]);
    const Vec3 middle = mean_of(p, at);
    double least = 1;
    for (std::size_t c = 0; c < at.size(); ++c) {
      least = std::min(least, radius_ratio(middle, p[at[c]], p[at[c + 1 == at.size() ? 0 : c + 1]]));
    }
    return std::min(1.0, least / regular_ratio(at.size()));
  }

  /// Calls use(degrees) for every corner between two edges that have a length.
  template <typename Use>
  void for_each_angle(std::size_t f, const Use& use) const {
    const auto at = corners(f);
    if (at.size() < 3) return;
    for (std::size_t c = 0; c < at.size(); ++c) {
      const Vec3& here = mesh_.points[at[c]];
      const Vec3 forward = mesh_.points[at[c + 1 == at.size() ? 0 : c + 1]] - here;
      const Vec3 back = mesh_.points[at[c == 0 ? at.size() - 1 : c - 1]] - here;
      if (length(forward) > 0 && length(back) > 0) use(angle_between(forward, back) * 180 / pi);
    }
  }

  Measured measure(std::size_t f, std::vector<PointId>& scratch) const {
    Measured m;
    m.quality = face_quality(f);
    m.area = length(vector_area(mesh_.points, corners(f)));
    for_each_angle(f, [&](double degrees) {
      m.least_angle = std::min(m.least_angle, degrees);
      m.largest_angle = std::max(m.largest_angle, degrees);
    });
    scratch.assign(corners(f).begin(), corners(f).end());
    std::sort(scratch.begin(), scratch.end());
    m.repeats = std::adjacent_find(scratch.begin(), scratch.end()) != scratch.end();
    return m;
  }

 private:
  const Mesh& mesh_;
  const std::vector<std::uint64_t> offsets_;
};

void add_curvature(SurfaceQuality& result) {
  const MeanCurvature& curvature = result.mean_curvature;
  double sum = 0, area = 0;
  for (std::size_t i = 0; i < result.points; ++i) {
    if (!curvature.defined(i)) continue;
    ++result.curvature_points;
    sum += curvature.value[i] * curvature.area[i];
    area += curvature.area[i];
    if (curvature.value[i] > result.largest_mean_curvature.value) result.largest_mean_curvature = {curvature.value[i], i};
  }
  if (area > 0) result.average_mean_curvature = sum / area;
}

}  // namespace

SurfaceQuality surface_quality(const Mesh& mesh, const RunContext& context) {
  const std::size_t n = mesh.face_count();
  if (n == 0) throw Error(ErrorCode::invalid_argument, "the mesh has no faces");
  const Surface surface(mesh);
  std::vector<Measured> all(n);
  parallel_for(context, n, surface_elements_per_range, [&](std::size_t begin, std::size_t end) {
    std::vector<PointId> scratch;
    for (std::size_t f = begin; f < end; ++f) all[f] = surface.measure(f, scratch);
  });
  SurfaceQuality result;
  result.points = mesh.point_count();
  result.faces = n;
  result.least_face_quality.value = result.least_area.value = infinity;
  result.largest_area.value = -infinity;
  result.least_angle.value = 180;
  const double diagonal = bounding_box(mesh.points).diagonal();
  result.face_quality.resize(n);
  for (std::size_t f = 0; f < n; ++f) {
    const Measured& m = all[f];
    result.face_quality[f] = m.quality;
    if (m.quality < result.least_face_quality.value) result.least_face_quality = {m.quality, f};
    result.average_face_quality += m.quality / static_cast<double>(n);
    ++result.histogram[bin_of(m.quality, 0, 1, SurfaceQuality::bins)];
    if (m.least_angle < result.least_angle.value) result.least_angle = {m.least_angle, f};
    if (m.largest_angle > result.largest_angle.value) result.largest_angle = {m.largest_angle, f};
    surface.for_each_angle(
        f, [&](double degrees) { ++result.angle_histogram[bin_of(degrees, 0, 180, SurfaceQuality::angle_bins)]; });
    if (m.area < result.least_area.value) result.least_area = {m.area, f};
    if (m.area > result.largest_area.value) result.largest_area = {m.area, f};
    result.total_area += m.area;
    if (mesh.face_sizes[f] >= 3 && !m.repeats && m.area >= least_area(mesh.points, surface.corners(f), diagonal)) continue;
    ++result.degenerate_faces;
    if (result.degenerate.size() < most_listed) result.degenerate.push_back(f);
  }
  result.worst = worst_of(n, [&](std::size_t f) { return all[f].quality; });
  result.mean_curvature = mean_curvature(mesh, Adjacency(mesh), context);
  add_curvature(result);
  return result;
}

}  // namespace deform
