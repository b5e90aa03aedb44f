// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/sampling/stratified.h"

#include <algorithm>
#include <cstdint>

namespace deform {

namespace {

/// Output i of splitmix64 (Steele, Lea, Flood: Fast splittable pseudorandom number generators, 2014).
std::uint64_t mixed(std::uint64_t i) {
  std::uint64_t z = (i + 1) * 0x9E3779B97F4A7C15u;
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
  return z ^ (z >> 31);
}

}  // namespace

std::vector<std::size_t> stratified_numbers(std::size_t count, std::size_t most) {
  const std::size_t parts = std::min(count, most);
  std::vector<std::size_t> numbers;
  numbers.reserve(parts);
  for (std::size_t i = 0; i < parts; ++i) {
    const std::size_t begin = i * count / parts, end = (i + 1) * count / parts;
    numbers.push_back(begin + mixed(i) % (end - begin));
  }
  return numbers;
}

}  // namespace deform
