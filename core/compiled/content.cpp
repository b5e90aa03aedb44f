// SPDX-License-Identifier: Apache-2.0
#include "core/compiled/content.h"

#include <algorithm>

namespace deform::compiled {

std::size_t following_points(const Content& content) {
  if (!content.held) return content.points();
  return static_cast<std::size_t>(std::count(content.regions.begin(), content.regions.end(), following_region));
}

std::vector<Vec3> following_places(const Content& content) {
  std::vector<Vec3> places;
  for (std::size_t i = 0; i < content.points(); ++i) {
    if (content.held && content.regions[i] != following_region) continue;
    Vec3 place{};
    for (std::size_t k = 0; k < 3; ++k) place[k] = (content.rest[i][k] - content.origin[k]) / content.scale;
    places.push_back(place);
  }
  return places;
}

}  // namespace deform::compiled
