// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstring>

namespace deform::compiled {

/// A number, or a struct of numbers, from unaligned bytes in the order of this machine, which is that of files.
template <typename T>
T number_at(const std::byte* from) {
  T value;
  std::memcpy(&value, from, sizeof value);
  return value;
}

}  // namespace deform::compiled
