// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <bit>
#include <concepts>
#include <cstring>

namespace deform::io {

/// Loads an unsigned integer from unaligned bytes in the given order.
template <std::unsigned_integral T>
T load_scalar(const char* bytes, std::endian order) {
  unsigned char raw[sizeof(T)];
  std::memcpy(raw, bytes, sizeof(T));
  T value = 0;
  for (std::size_t i = 0; i < sizeof(T); ++i) {
    value |= static_cast<T>(static_cast<T>(raw[i]) << (8 * (order == std::endian::little ? i : sizeof(T) - 1 - i)));
  }
  return value;
}

template <std::unsigned_integral T>
void store_scalar(char* bytes, T value, std::endian order) {
  for (std::size_t i = 0; i < sizeof(T); ++i) {
    bytes[i] = static_cast<char>(value >> (8 * (order == std::endian::little ? i : sizeof(T) - 1 - i)));
  }
}

}  // namespace deform::io
