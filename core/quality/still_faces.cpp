// SPDX-License-Identifier: Apache-2.0
#include "core/quality/still_faces.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>

#include "core/base/parallel.h"
#include "core/quality/polygon.h"

namespace deform::quality {

namespace {

constexpr std::size_t still_faces_per_range = 8192;
constexpr double sine = 0.5, sharp_sine = 0.2588;  // of 30 and 15 degrees
constexpr double float_rounding = 2.5e-7;          // of differences of floats, over the largest of them

// A displacement, and a 0: the components are handled at once, which compilers do not find out by themselves.
using Four = float __attribute__((vector_size(16)));
using Mask = std::int64_t __attribute__((vector_size(16)));

/// Whether all components are within -limit..limit; false for NaN.
inline Mask within(Four x, float limit) {
  const Four high = {limit, limit, limit, limit};
  return reinterpret_cast<Mask>((x <= high) & (x >= -high));
}
inline bool everywhere(Mask mask) { return (mask[0] & mask[1]) == -1; }

/// The k of a polygon of that many corners at which k + k^2 (c - 2) / 4 is `sine`.
double share(std::size_t corners, double sine_of_turn) {
  const double q = static_cast<double>(corners - 2) / 4;
  return (std::sqrt(1 + 4 * q * sine_of_turn) - 1) / (2 * q);
}

}  // namespace

StillFaces::StillFaces(const FaceCorners& corners, std::span<const Vec3> rest, std::span<const Vec3> normals,
                       std::span<const FacePair> sharp, const RunContext& context)
    : limits_(corners.size()) {
  std::vector<char> has_sharp(corners.size());
  for (const FacePair& pair : sharp) has_sharp[pair.first] = has_sharp[pair.second] = 1;
  parallel_for(context, limits_.size(), still_faces_per_range, [&](std::size_t begin, std::size_t end) {
    for (std::size_t f = begin; f < end; ++f) {
      const auto at = corners[f];
      limits_[f] = std::numeric_limits<float>::max();
      if (normals[f] == Vec3{}) continue;
      double lengths = 0;
      for (std::size_t c = 1; c + 1 < at.size(); ++c) {
        lengths += length(rest[at[c]] - rest[at[0]]) + length(rest[at[c + 1]] - rest[at[0]]);
      }
      const double area = 2 * length(vector_area(rest, at));
      const double most = share(at.size(), has_sharp[f] && at.size() == 3 ? sharp_sine : sine) * area / lengths;
      limits_[f] = static_cast<float>(0.999999 * most / std::sqrt(3.0));
    }
  });
}

void StillFaces::find_moved(const FaceCorners& corners, std::span<const Vec3> rest, std::span<const Vec3> points,
                            std::vector<char>& moved, const RunContext& context) const {
  if (limits_.empty()) return;
  const auto u = std::make_unique_for_overwrite<Four[]>(points.size());
  std::vector<float> largest((points.size() + still_faces_per_range - 1) / still_faces_per_range);
  parallel_for(context, points.size(), still_faces_per_range, [&](std::size_t begin, std::size_t end) {
    Four low = {}, high = {};
    for (std::size_t i = begin; i < end; ++i) {
      const Vec3 d = points[i] - rest[i];
      u[i] = Four{static_cast<float>(d[0]), static_cast<float>(d[1]), static_cast<float>(d[2]), 0};
      low = u[i] < low ? u[i] : low;
      high = u[i] > high ? u[i] : high;
    }
    largest[begin / still_faces_per_range] = std::max({high[0], high[1], high[2], -low[0], -low[1], -low[2]});
  });
  const float error = static_cast<float>(float_rounding) * *std::max_element(largest.begin(), largest.end());
  parallel_for(context, limits_.size(), still_faces_per_range, [&](std::size_t begin, std::size_t end) {
    if (corners.triangles()) {
      for (std::size_t f = begin; f < end; ++f) {
        const PointId* at = corners.triangle(f);
        const float limit = limits_[f] - error;
        moved[f] = !everywhere(within(u[at[1]] - u[at[0]], limit) & within(u[at[2]] - u[at[0]], limit));
      }
      return;
    }
    for (std::size_t f = begin; f < end; ++f) {
      const auto at = corners[f];
      const float limit = limits_[f] - error;
      Mask mask = {-1, -1};
      for (std::size_t c = 1; c < at.size(); ++c) mask &= within(u[at[c]] - u[at[0]], limit);
      moved[f] = !everywhere(mask);
    }
  });
}

}  // namespace deform::quality
