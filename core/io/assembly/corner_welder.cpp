// SPDX-License-Identifier: Apache-2.0
#include "core/io/assembly/corner_welder.h"

#include <algorithm>
#include <bit>
#include <cstdint>

namespace deform::io {

namespace {

std::uint64_t mixed(std::uint64_t x) {  // finalizer of splitmix64
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31);
}

std::uint64_t hash_of(const Vec3& place) {
  std::uint64_t hash = 0;
  for (const double c : place) hash = mixed(hash + 0x9e3779b97f4a7c15ULL + std::bit_cast<std::uint64_t>(c + 0.0));  // -0 + 0 = 0
  return hash;
}

}  // namespace

std::size_t CornerWelder::slot_of(const Vec3& place) const {
  const std::size_t last = slots_.size() - 1;
  std::size_t slot = hash_of(place) & last;
  while (slots_[slot] != empty_slot && points_[slots_[slot]] != place) slot = (slot + 1) & last;
  return slot;
}

void CornerWelder::grow() {
  constexpr std::size_t smallest = 64;
  slots_.assign(std::max(smallest, slots_.size() * 2), empty_slot);
  for (std::size_t i = 0; i < points_.size(); ++i) slots_[slot_of(points_[i])] = static_cast<PointId>(i);
}

PointId CornerWelder::weld(const Vec3& place) {
  if (points_.size() * 2 >= slots_.size()) grow();
  PointId& slot = slots_[slot_of(place)];
  if (slot == empty_slot) {
    slot = static_cast<PointId>(points_.size());
    points_.push_back(place);
  }
  return slot;
}

}  // namespace deform::io
