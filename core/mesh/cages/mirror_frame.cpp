// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/cages/mirror_frame.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdio>
#include <limits>
#include <string>
#include <vector>

#include "core/base/direction.h"
#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/vectors.h"

namespace deform {

namespace {

/// What rounding does not decide: a model on both sides of a plane.
constexpr double as_far = 1e-3;

[[noreturn]] void refuse_plane(std::size_t plane, const std::string& reason) {
  throw Error(ErrorCode::invalid_argument, "planes[" + std::to_string(plane) + "]: " + reason);
}

/// A unit vector at right angles to one, along an axis if there is such an axis.
Vec3 at_right_angles(const Vec3& n) {
  std::size_t least = 0;
  for (std::size_t k = 1; k < 3; ++k) {
    if (std::abs(n[k]) < std::abs(n[least])) least = k;
  }
  Vec3 e{};
  e[least] = 1;
  const Vec3 across = e - n[least] * n;
  return across / norm(across);
}

/// As messages have it.
std::string short_number(double value) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.4g", value);
  return text.data();
}

}  // namespace

std::string place_text(const Vec3& place) {
  std::string text;
  for (const double x : place) text += (text.empty() ? "(" : ", ") + short_number(x);
  return text + ")";
}

std::optional<std::size_t> axis_of(const CagePlane& plane) {
  const double size = norm(plane.normal);
  for (std::size_t k = 0; k < 3; ++k) {
    if (std::abs(plane.normal[k]) >= (1 - 1e-12) * size) return k;
  }
  return std::nullopt;
}

std::string plane_text(const CagePlane& plane) {
  constexpr std::array<char, 3> names{'x', 'y', 'z'};
  if (const auto k = axis_of(plane)) return std::string(1, names[*k]) + " = " + short_number(plane.point[*k]);
  return "the plane through " + place_text(plane.point) + " across " + place_text(plane.normal / norm(plane.normal));
}

std::string planes_text(std::span<const CagePlane> planes) {
  std::string text;
  for (std::size_t i = 0; i < planes.size(); ++i) {
    text += (i == 0 ? "" : i + 1 == planes.size() ? " and " : ", ") + plane_text(planes[i]);
  }
  return text;
}

Vec3 reflected(const CagePlane& plane, const Vec3& x) { return x - 2 * dot(plane.normal, x - plane.point) * plane.normal; }

MirrorFrame::MirrorFrame(std::span<const CagePlane> planes, const Mesh& mesh) : planes_(planes.size()) {
  if (planes_ > 3) refuse_plane(3, "there are at most 3 that are orthogonal to each other");
  for (std::size_t k = 0; k < planes_; ++k) {
    if (!is_finite(planes[k].point)) refuse_plane(k, "its point must be finite");
    if (const char* problem = direction_problem(planes[k].normal)) refuse_plane(k, std::string("its normal ") + problem);
    Vec3 axis = planes[k].normal / norm(planes[k].normal);
    for (std::size_t j = 0; j < k; ++j) {
      const double cosine = dot(axis, axes_[j]);
      if (std::abs(cosine) > orthogonality) {
        refuse_plane(k, "it is not orthogonal to planes[" + std::to_string(j) + "], the cosine of the angle between them is " +
                            number_digits(cosine));
      }
      axis = axis - cosine * axes_[j];
    }
    axis = axis / norm(axis);
    double above = 0, below = 0;
    for (const Vec3& x : mesh.points) {
      const double height = dot(axis, x - planes[k].point);
      above = std::max(above, height);
      below = std::max(below, -height);
    }
    axes_[k] = below > above * (1 + as_far) ? -1.0 * axis : axis;
    origin_ = origin_ + dot(axes_[k], planes[k].point - origin_) * axes_[k];
  }
  if (planes_ == 1) axes_[1] = at_right_angles(axes_[0]);
  if (planes_ == 1 || planes_ == 2) axes_[2] = cross(axes_[0], axes_[1]);
}

Vec3 MirrorFrame::coordinates(const Vec3& point) const {
  const Vec3 x = point - origin_;
  return {dot(axes_[0], x), dot(axes_[1], x), dot(axes_[2], x)};
}

Vec3 MirrorFrame::point(const Vec3& coordinates) const {
  return origin_ + (coordinates[0] * axes_[0] + coordinates[1] * axes_[1] + coordinates[2] * axes_[2]);
}

bool MirrorFrame::is_right_handed() const { return dot(cross(axes_[0], axes_[1]), axes_[2]) > 0; }

Mesh with_images(const Mesh& mesh, std::size_t planes) {
  Mesh whole;
  std::vector<std::vector<PointId>> numbers;  // of each image
  for (unsigned image = 0; image < 1U << planes; ++image) {
    std::vector<PointId>& own = numbers.emplace_back();
    for (std::size_t i = 0; i < mesh.point_count(); ++i) {
      Vec3 x = mesh.points[i];
      unsigned reflected = image;
      for (std::size_t k = 0; k < planes; ++k) {
        if (x[k] == 0) reflected &= ~(1U << k);
        if ((reflected >> k & 1U) != 0) x[k] = -x[k];
      }
      // A point in a plane is that of the image without the reflection there, which comes before.
      own.push_back(reflected == image ? static_cast<PointId>(whole.points.size()) : numbers[reflected][i]);
      if (reflected == image) whole.points.push_back(x);
    }
    for (std::size_t c = 0; c < mesh.face_points.size(); c += 3) {
      const PointId a = own[mesh.face_points[c]], b = own[mesh.face_points[c + 1]], d = own[mesh.face_points[c + 2]];
      const bool turned = std::popcount(image) % 2 != 0;
      whole.face_sizes.push_back(3);
      whole.face_points.insert(whole.face_points.end(), {a, turned ? d : b, turned ? b : d});
    }
  }
  return whole;
}

Mesh part_beyond(const Mesh& mesh, std::size_t planes) {
  constexpr PointId none = std::numeric_limits<PointId>::max();
  std::vector<PointId> numbers(mesh.point_count(), none);
  std::vector<std::size_t> kept;
  for (std::size_t c = 0; c < mesh.face_points.size(); c += 3) {
    bool beyond = true;
    for (std::size_t k = 0; k < planes; ++k) {
      const auto height = [&](std::size_t corner) { return mesh.points[mesh.face_points[c + corner]][k]; };
      beyond = beyond && std::max({height(0), height(1), height(2)}) > 0;
    }
    if (!beyond) continue;
    kept.push_back(c);
    for (std::size_t corner = 0; corner < 3; ++corner) numbers[mesh.face_points[c + corner]] = 0;
  }
  Mesh part;
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    if (numbers[i] == none) continue;
    numbers[i] = static_cast<PointId>(part.points.size());
    part.points.push_back(mesh.points[i]);
  }
  for (const std::size_t c : kept) {
    part.face_sizes.push_back(3);
    for (std::size_t corner = 0; corner < 3; ++corner) part.face_points.push_back(numbers[mesh.face_points[c + corner]]);
  }
  return part;
}

}  // namespace deform
