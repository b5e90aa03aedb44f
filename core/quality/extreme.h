// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

namespace deform {

/// An extreme value and the id of the point, face, cell or element that has it.
struct Extreme {
  double value = 0;    ///< the extreme value
  std::size_t id = 0;  ///< the entity that has it
};

}  // namespace deform
