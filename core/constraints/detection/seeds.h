// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "core/base/run_context.h"
#include "core/constraints/detection/growth.h"

namespace deform::detection {

/// Random numbers that depend on nothing but their seeds (SplitMix64).
class Random {
 public:
  Random(std::uint64_t seed, std::uint64_t stream) : state_(seed * 0x9e3779b97f4a7c15ull + stream * 0xd1342543de82ef95ull + 1) {}
  std::size_t below(std::size_t count);
  double unit();  ///< 0 <= x < 1

 private:
  std::uint64_t next();
  std::uint64_t state_;
};

/// Faces by smooth patches: those that edges of less than `angle` connect.
struct Patches {
  std::vector<FaceId> order;       ///< all faces with an area, patch by patch, breadth first
  std::vector<std::size_t> begin;  ///< first of each patch in order; one more entry at the end
};
Patches smooth_patches(const Surface& surface, double angle);

/// Regions that grow from whole patches between edges of the maximum angle, half and a quarter of it, as far as patches are large
/// enough and not labelled yet. By falling area.
std::vector<Region> grown_from_patches(const Surface& surface, const Limits& limits, GrowthPool& pool,
                                       std::span<const std::uint32_t> labels, const RunContext& context);

/// Seeds for primitives of the smallest area: two on the area of each, spread over the unlabelled faces, each the one of a few
/// around which curvature changes least. `sweep` makes other ones.
std::vector<FaceId> spread_seeds(const Surface& surface, const Limits& limits, const Patches& patches,
                                 std::span<const double> unevenness, std::span<const std::uint32_t> labels, std::uint64_t sweep);

/// How much the bending per area changes from each face to its neighbours.
std::vector<double> curvature_unevenness(const Surface& surface);

/// The regions that grow from surroundings of a seed of several sizes, at most one of each kind and size.
std::vector<Region> grown_from_seed(const Surface& surface, const Limits& limits, Growth& growth, FaceId seed,
                                    std::span<const std::uint32_t> labels);

}  // namespace deform::detection
