// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "core/base/run_context.h"
#include "core/constraints/detection/growth.h"

namespace deform::detection {

/// A deterministic pseudo-random number generator (SplitMix64).
class Random {
 public:
  Random(std::uint64_t seed, std::uint64_t stream) : state_(seed * 0x9e3779b97f4a7c15ull + stream * 0xd1342543de82ef95ull + 1) {}
  std::size_t below(std::size_t count);
  double unit();  ///< 0 <= x < 1

 private:
  std::uint64_t next();
  std::uint64_t state_;
};

/// The faces grouped into smooth patches, which are connected across edges with angles below a limit.
struct Patches {
  std::vector<FaceId> order;       ///< all faces with an area, patch by patch, breadth first
  std::vector<std::size_t> begin;  ///< offsets of the patches in `order`, and its size
};
Patches smooth_patches(const Surface& surface, double angle);

/// Regions that grow from whole patches between edges of the maximum angle, half and a quarter of it, if the patches are large
/// enough and not labelled yet. Sorted by descending area.
std::vector<Region> grown_from_patches(const Surface& surface, const Limits& limits, GrowthPool& pool,
                                       std::span<const std::uint32_t> labels, const RunContext& context);

/// Seeds spread over the unlabelled faces, two for each area of the smallest primitive. Each is the one of a few candidates
/// around which the curvature changes least. Each `sweep` gives other seeds.
std::vector<FaceId> spread_seeds(const Surface& surface, const Limits& limits, const Patches& patches,
                                 std::span<const double> unevenness, std::span<const std::uint32_t> labels, std::uint64_t sweep);

/// For each face, how much the curvature changes from it to its neighbours.
std::vector<double> curvature_unevenness(const Surface& surface);

/// The regions that grow from neighbourhoods of several sizes around a seed, at most one for each kind and size.
std::vector<Region> grown_from_seed(const Surface& surface, const Limits& limits, Growth& growth, FaceId seed,
                                    std::span<const std::uint32_t> labels);

}  // namespace deform::detection
