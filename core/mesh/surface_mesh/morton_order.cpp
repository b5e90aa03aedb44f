// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/surface_mesh/morton_order.h"

#include <algorithm>
#include <utility>

namespace deform {

namespace {

constexpr std::uint64_t cells = std::uint64_t{1} << 21;

/// Spreads 21 bits, with two zero bits after each.
std::uint64_t spread(std::uint64_t x) {
  x = (x | x << 32) & 0x1f00000000ffff;
  x = (x | x << 16) & 0x1f0000ff0000ff;
  x = (x | x << 8) & 0x100f00f00f00f00f;
  x = (x | x << 4) & 0x10c30c30c30c30c3;
  return (x | x << 2) & 0x1249249249249249;
}

}  // namespace

void sort_along_morton_curve(std::span<const Vec3> points, std::vector<std::uint32_t>& ids) {
  const Box box = bounding_box(points, ids);
  const double side = std::max({box.side(0), box.side(1), box.side(2)});
  const double scale = side > 0 ? static_cast<double>(cells - 1) / side : 0;
  std::vector<std::pair<std::uint64_t, std::uint32_t>> keys;
  keys.reserve(ids.size());
  for (const std::uint32_t id : ids) {
    std::uint64_t key = 0;
    for (int k = 0; k < 3; ++k) key |= spread(static_cast<std::uint64_t>((points[id][k] - box.min[k]) * scale)) << k;
    keys.emplace_back(key, id);
  }
  std::sort(keys.begin(), keys.end());
  for (std::size_t i = 0; i < ids.size(); ++i) ids[i] = keys[i].second;
}

}  // namespace deform
