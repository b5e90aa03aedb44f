// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

namespace deform {

/// A value and where it was found: id of a face, a cell or an element.
struct Extreme {
  double value = 0;
  std::size_t id = 0;
};

}  // namespace deform
