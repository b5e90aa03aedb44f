// SPDX-License-Identifier: Apache-2.0
#include "core/compiled/content.h"

#include <algorithm>

namespace deform::compiled {

std::size_t following_points(const Content& content) {
  if (!content.held) return content.points();
  return static_cast<std::size_t>(std::count(content.regions.begin(), content.regions.end(), following_region));
}

}  // namespace deform::compiled
