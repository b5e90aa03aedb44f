// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/point_owners.h"

namespace deform {

std::string PointOwners::Overlap::text(const std::string& other_name, const std::string& noun) const {
  return "overlaps " + other_name + ": " + std::to_string(points) + " common " + noun + "s, the first is " + noun + " " +
         std::to_string(first) + "; subtract one region from the other with `difference`";
}

PointOwners::Overlap PointOwners::claim(std::span<const PointId> ids, std::uint32_t owner) {
  Overlap overlap;
  for (const PointId id : ids) {
    if (owners_[id] == nobody || owners_[id] == owner) {
      owners_[id] = owner;
      continue;
    }
    if (overlap.points == 0) {
      overlap.first = id;
      overlap.other = owners_[id];
    }
    if (owners_[id] == overlap.other) ++overlap.points;
  }
  return overlap;
}

}  // namespace deform
