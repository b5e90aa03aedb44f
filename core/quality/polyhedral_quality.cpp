// SPDX-License-Identifier: Apache-2.0
#include "core/quality/polyhedral_quality.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "core/base/checks.h"
#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/quality/moving_cells.h"
#include "core/quality/summary.h"

namespace deform {

namespace {

using namespace quality;

constexpr double tiny = 1e-150;  // OpenFOAM's ROOTVSMALL
constexpr double right = 1e-15;  // OpenFOAM's SMALL: a cosine that is no larger is an error
constexpr std::size_t polyhedra_per_range = 4096;

class Measures {
 public:
  Measures(std::span<const Vec3> points, const PolyhedralCells& cells, const PolyhedralLimits& limits, const RunContext& context)
      : points_(points), cells_(cells), limits_(limits), context_(context) {}

  PolyhedralQuality run() {
    result_.points = points_.size();
    result_.faces = cells_.face_count();
    result_.internal_faces = cells_.internal_faces();
    result_.cells = cells_.cell_count;
    if (result_.cells == 0) throw Error(ErrorCode::invalid_argument, "the mesh has no cells");
    measure_faces();
    measure_cells();
    find_directions();
    rate_cells();
    rate_faces();
    find_inverted();
    result_.cell_volume = std::move(volume_);
    return result_;
  }

 private:
  void measure_faces() {
    const std::size_t n = cells_.face_count();
    centre_.resize(n);
    area_.resize(n);
    flatness_.resize(n);
    parallel_for(context_, n, polyhedra_per_range, [&](std::size_t begin, std::size_t end) {
      for (std::size_t f = begin; f < end; ++f) measure_face(f);
    });
    result_.least_area.value = std::numeric_limits<double>::infinity();
    for (std::size_t f = 0; f < n; ++f) {
      const double size = length(area_[f]);
      if (size < result_.least_area.value) result_.least_area = {size, f};
      if (size > result_.largest_area.value) result_.largest_area = {size, f};
      result_.small_faces += size < limits_.face_area;
      if (flatness_[f] < result_.least_flatness.value) result_.least_flatness = {flatness_[f], f};
    }
  }

  // A polygon is the fan of triangles around the mean of its corners.
  void measure_face(std::size_t f) {
    const auto corners = cells_.face(f);
    check_ids(corners, points_.size(), FieldEntry{"faces", f}, "point");
    flatness_[f] = 1;
    if (corners.size() == 3) {
      const Vec3 &a = points_[corners[0]], &b = points_[corners[1]], &c = points_[corners[2]];
      centre_[f] = (1.0 / 3) * (a + b + c);
      area_[f] = 0.5 * cross(b - a, c - a);
      return;
    }
    Vec3 middle{};
    for (const PointId p : corners) middle = middle + points_[p];
    middle = (1.0 / std::max<double>(1, static_cast<double>(corners.size()))) * middle;
    Vec3 normals{}, moments{};
    double sizes = 0;
    for (std::size_t c = 0; c < corners.size(); ++c) {
      const Vec3 &p = points_[corners[c]], &next = points_[corners[(c + 1) % corners.size()]];
      const Vec3 normal = cross(next - p, middle - p);
      const double size = length(normal);
      normals = normals + normal;
      sizes += size;
      moments = moments + size * (p + next + middle);
    }
    area_[f] = 0.5 * normals;
    centre_[f] = sizes < tiny ? middle : (1.0 / 3 / sizes) * moments;
    if (sizes >= tiny) flatness_[f] = length(normals) / sizes;
  }

  /// Calls use(cell, face, sign) for both sides of every face, in the order of the faces.
  template <typename Use>
  void for_each_side(const Use& use) const {
    for (std::size_t f = 0; f < cells_.face_count(); ++f) {
      use(cells_.owner[f], f, 1.0);
      if (f < cells_.internal_faces()) use(cells_.neighbour[f], f, -1.0);
    }
  }

  void measure_cells() {
    const std::size_t n = cells_.cell_count;
    std::vector<Vec3> estimate(n, Vec3{});
    std::vector<std::uint32_t> sides(n, 0);
    for_each_side([&](std::size_t c, std::size_t f, double) {
      estimate[c] = estimate[c] + centre_[f];
      ++sides[c];
    });
    for (std::size_t c = 0; c < n; ++c) estimate[c] = (1.0 / std::max(1u, sides[c])) * estimate[c];
    cell_centre_.assign(n, Vec3{});
    volume_.assign(n, 0.0);
    for_each_side([&](std::size_t c, std::size_t f, double sign) {
      const double pyramid = sign * dot(area_[f], centre_[f] - estimate[c]);
      cell_centre_[c] = cell_centre_[c] + pyramid * (0.75 * centre_[f] + 0.25 * estimate[c]);
      volume_[c] += pyramid;
    });
    result_.least_volume.value = std::numeric_limits<double>::infinity();
    result_.largest_volume.value = -std::numeric_limits<double>::infinity();
    for (std::size_t c = 0; c < n; ++c) {
      cell_centre_[c] = std::abs(volume_[c]) > 1e-300 ? (1 / volume_[c]) * cell_centre_[c] : estimate[c];
      volume_[c] /= 3;
      if (volume_[c] < result_.least_volume.value) result_.least_volume = {volume_[c], c};
      if (volume_[c] > result_.largest_volume.value) result_.largest_volume = {volume_[c], c};
      result_.total_volume += volume_[c];
      result_.negative_volumes += volume_[c] < limits_.volume;
    }
  }

  void find_inverted() {
    const auto moving = moving_polyhedra(cells_, points_.size());
    result_.left_handed = static_cast<std::size_t>(std::count(limits_.left_handed.begin(), limits_.left_handed.end(), 1));
    moving->take_as_left_handed(limits_.left_handed);
    std::vector<char> inverted(result_.cells);
    parallel_for(context_, inverted.size(), polyhedra_per_range, [&](std::size_t begin, std::size_t end) {
      for (std::size_t c = begin; c < end; ++c) inverted[c] = moving->state(points_, c).inverted;
    });
    for (std::size_t c = 0; c < inverted.size(); ++c) {
      if (!inverted[c]) continue;
      ++result_.inverted_cells;
      if (result_.inverted.size() < most_listed) result_.inverted.push_back(c);
    }
  }

  // Patches of type "empty" take their mean direction out, as in a 2D mesh of one layer of cells.
  void find_directions() {
    Vec3 sum{};
    for (std::size_t f = 0; f < cells_.empty_faces.size(); ++f) {
      if (cells_.empty_faces[f] == 0) continue;
      const Vec3 normal = (1 / (length(area_[f]) + tiny)) * area_[f];
      for (int k = 0; k < 3; ++k) sum[k] += std::abs(normal[k]);
    }
    const double size = length(sum);
    if (size == 0) return;
    for (int k = 0; k < 3; ++k) {
      if (sum[k] / size <= 1e-6) continue;
      counts_[k] = false;
      --result_.geometric_dimensions;
    }
  }

  void rate_cells() {
    const std::size_t n = cells_.cell_count;
    std::vector<Vec3> closed(n, Vec3{}), magnitudes(n, Vec3{});
    for_each_side([&](std::size_t c, std::size_t f, double sign) {
      for (int k = 0; k < 3; ++k) {
        closed[c][k] += sign * area_[f][k];
        magnitudes[c][k] += std::abs(area_[f][k]);
      }
    });
    for (std::size_t c = 0; c < n; ++c) {
      double openness = 0, least = std::numeric_limits<double>::infinity(), largest = 0, sum = 0;
      for (int k = 0; k < 3; ++k) {
        openness = std::max(openness, std::abs(closed[c][k]) / (magnitudes[c][k] + tiny));
        sum += magnitudes[c][k];
        if (!counts_[k]) continue;
        least = std::min(least, magnitudes[c][k]);
        largest = std::max(largest, magnitudes[c][k]);
      }
      double aspect = largest / (least + tiny);
      if (result_.geometric_dimensions == 3) {
        aspect = std::max(aspect, sum / 6 / std::pow(std::max(tiny, volume_[c]), 2.0 / 3));
      }
      if (openness > result_.largest_openness.value) result_.largest_openness = {openness, c};
      if (aspect > result_.largest_aspect_ratio.value) result_.largest_aspect_ratio = {aspect, c};
      result_.open_cells += openness > limits_.openness;
      result_.slender_cells += aspect > limits_.aspect_ratio;
    }
  }

  void rate_faces() {
    const std::size_t n = cells_.face_count(), internal = cells_.internal_faces();
    std::vector<double> cosine(internal), skewness(n);
    std::vector<char> wrong(n);  // pyramids
    parallel_for(context_, n, polyhedra_per_range, [&](std::size_t begin, std::size_t end) {
      for (std::size_t f = begin; f < end; ++f) {
        const Vec3& own = cell_centre_[cells_.owner[f]];
        wrong[f] = dot(area_[f], centre_[f] - own) / 3 < limits_.pyramid_volume ? 1 : 0;
        if (f < internal) {
          const Vec3& other = cell_centre_[cells_.neighbour[f]];
          const Vec3 d = other - own;
          cosine[f] = dot(d, area_[f]) / (length(d) * length(area_[f]) + tiny);
          skewness[f] = skew(f, own, d, 0.2);
          wrong[f] = static_cast<char>(wrong[f] + (dot(area_[f], other - centre_[f]) / 3 < limits_.pyramid_volume ? 1 : 0));
        } else {
          const Vec3 normal = (1 / (length(area_[f]) + tiny)) * area_[f];
          skewness[f] = skew(f, own, dot(normal, centre_[f] - own) * normal, 0.4);
        }
      }
    });
    double sum = 0;
    Extreme least_cosine{std::numeric_limits<double>::infinity(), 0};
    const double severe = std::cos(limits_.non_orthogonality * std::numbers::pi / 180);
    for (std::size_t f = 0; f < internal; ++f) {
      sum += cosine[f];
      if (cosine[f] < least_cosine.value) least_cosine = {cosine[f], f};
      if (cosine[f] >= severe) continue;
      ++(cosine[f] > right ? result_.non_orthogonal_faces : result_.non_orthogonality_errors);
    }
    const auto degrees = [](double c) { return std::acos(std::clamp(c, -1.0, 1.0)) * 180 / std::numbers::pi; };
    list_non_orthogonality(cosine, degrees);
    if (internal > 0) {
      result_.largest_non_orthogonality = {degrees(least_cosine.value), least_cosine.id};
      result_.average_non_orthogonality = degrees(sum / static_cast<double>(internal));
    }
    for (std::size_t f = 0; f < n; ++f) {
      if (skewness[f] > result_.largest_skewness.value) result_.largest_skewness = {skewness[f], f};
      result_.skew_faces += skewness[f] > limits_.skewness;
      ++result_.skewness_histogram[bin_of(skewness[f], 0, 4, PolyhedralQuality::skewness_bins)];
      result_.wrong_pyramids += static_cast<std::size_t>(wrong[f]);
      if (wrong[f] > 0 && result_.wrong_faces.size() < most_listed) result_.wrong_faces.push_back(f);
    }
  }

  template <typename Degrees>
  void list_non_orthogonality(const std::vector<double>& cosine, const Degrees& degrees) {
    result_.worst = worst_of(cosine.size(), [&](std::size_t f) { return cosine[f]; });
    result_.cell_non_orthogonality.assign(cells_.cell_count, 0);
    result_.face_non_orthogonality.resize(cosine.size());
    for (std::size_t f = 0; f < cosine.size(); ++f) {
      const double angle = result_.face_non_orthogonality[f] = degrees(cosine[f]);
      ++result_.histogram[bin_of(angle, 0, 90, PolyhedralQuality::bins)];
      for (const std::uint32_t cell : {cells_.owner[f], cells_.neighbour[f]}) {
        result_.cell_non_orthogonality[cell] = std::max(result_.cell_non_orthogonality[cell], angle);
      }
    }
  }

  // How far the face's centre is from where d crosses it, against the extent of the face in that direction.
  double skew(std::size_t f, const Vec3& own, const Vec3& d, double share) const {
    const Vec3 to_face = centre_[f] - own;
    const Vec3 off = to_face - (dot(area_[f], to_face) / (dot(area_[f], d) + tiny)) * d;
    const Vec3 direction = (1 / (length(off) + tiny)) * off;
    double extent = share * length(d) + tiny;
    for (const PointId p : cells_.face(f)) extent = std::max(extent, std::abs(dot(direction, points_[p] - centre_[f])));
    return length(off) / extent;
  }

  const std::span<const Vec3> points_;
  const PolyhedralCells& cells_;
  const PolyhedralLimits& limits_;
  const RunContext& context_;
  PolyhedralQuality result_;
  std::vector<Vec3> centre_, area_;  ///< of faces
  std::vector<double> flatness_;
  std::vector<Vec3> cell_centre_;
  std::vector<double> volume_;
  std::array<bool, 3> counts_{true, true, true};
};

}  // namespace

std::vector<PolyhedralQuality::Failure> PolyhedralQuality::failures() const {
  std::vector<Failure> failed;
  const auto check = [&](const char* name, std::size_t count) {
    if (count > 0) failed.push_back({name, count});
  };
  if (slender_cells == 0) {
    check("open cells", open_cells);
  } else {
    check(open_cells > 0 ? "open cells, and aspect ratio" : "aspect ratio", open_cells + slender_cells);
  }
  check("face areas", small_faces);
  check("cell volumes", negative_volumes);
  check("non-orthogonality", non_orthogonality_errors);
  check("face pyramids", wrong_pyramids);
  check("skewness", skew_faces);
  return failed;
}

std::size_t PolyhedralQuality::failed_checks() const { return failures().size(); }

PolyhedralQuality polyhedral_quality(std::span<const Vec3> points, const PolyhedralCells& cells, const PolyhedralLimits& limits,
                                     const RunContext& context) {
  return Measures(points, cells, limits, context).run();
}

}  // namespace deform
