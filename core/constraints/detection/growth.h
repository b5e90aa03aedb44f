// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <vector>

#include "core/constraints/detection/shape.h"
#include "core/constraints/detection/surface.h"

namespace deform::detection {

/// The options of detection, with lengths divided by the size of the surface.
struct Limits {
  double tolerance = 0;      ///< largest distance of a corner
  double floor = 0;          ///< distances below this are always accepted
  double maximum_angle = 0;  ///< across an edge
  double minimum_area = 0;
  std::uint64_t seed = 0;
  std::vector<PrimitiveKind> kinds;

  /// The threshold for a primitive whose corners have this rms distance.
  double threshold(double rms) const { return std::min(tolerance, std::max(floor, 4 * rms)); }
};

/// A shape and the faces that lie on it.
struct Region {
  Shape shape;
  std::vector<FaceId> faces;
  double area = 0;
  double rms = 0;
};

/// The label of a face that belongs to no region.
inline constexpr std::uint32_t unlabelled = 0xffffffff;

/// Whether all corners of the face are within `threshold` of the shape, and its normal agrees with that of the shape up to half
/// the maximum angle plus the effect of noise.
bool fits(const Surface& surface, const Shape& shape, FaceId face, double threshold);

/// Region growing over the unlabelled faces. Stores a mark for each face, so each thread needs its own object.
class Growth {
 public:
  Growth(const Surface& surface, const Limits& limits) : surface_(surface), limits_(limits), marks_(surface.face_count(), 0) {}

  /// Collects faces around `seed`, which comes first, ring by ring without crossing sharp edges, until they reach both this area
  /// and this count.
  std::vector<FaceId> neighbourhood(FaceId seed, double area, std::size_t count, std::span<const std::uint32_t> labels);

  /// Grows from `start` and refits after each round. The threshold follows the rms distance of the current region, and each round
  /// has at most four times as many faces as the last, so that a first guess from few faces improves before it extends far.
  /// Returns std::nullopt if the shape deviates from `start` by more than the tolerance, or if the region loses `start`.
  std::optional<Region> converged(const Shape& shape, std::span<const FaceId> start, std::span<const std::uint32_t> labels);

 private:
  /// The largest connected set of fitting faces that contains a face of `start`, breadth first, at most `most` faces.
  std::vector<FaceId> grown(const Shape& shape, double threshold, std::span<const FaceId> start, std::size_t most,
                            std::span<const std::uint32_t> labels);
  void flood(const Shape& shape, double threshold, std::size_t most, std::span<const std::uint32_t> labels,
             std::vector<FaceId>& piece);
  void next_mark();

  const Surface& surface_;
  const Limits& limits_;
  std::vector<std::uint32_t> marks_;  ///< == mark_: seen in this pass
  std::uint32_t mark_ = 0;
};

/// A pool of Growth objects for concurrent threads. Thread-safe.
class GrowthPool {
 public:
  GrowthPool(const Surface& surface, const Limits& limits) : surface_(surface), limits_(limits) {}
  template <typename Use>
  void with(const Use& use) {
    std::unique_ptr<Growth> growth;
    {
      const std::lock_guard lock(mutex_);
      if (!free_.empty()) {
        growth = std::move(free_.back());
        free_.pop_back();
      }
    }
    if (!growth) growth = std::make_unique<Growth>(surface_, limits_);
    use(*growth);
    const std::lock_guard lock(mutex_);
    free_.push_back(std::move(growth));
  }

 private:
  const Surface& surface_;
  const Limits& limits_;
  std::mutex mutex_;
  std::vector<std::unique_ptr<Growth>> free_;
};

double area_of(const Surface& surface, std::span<const FaceId> faces);

}  // namespace deform::detection
