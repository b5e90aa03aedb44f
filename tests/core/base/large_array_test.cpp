// SPDX-License-Identifier: GPL-3.0-or-later
// Memory of large arrays: where it begins, and what it is asked for in.
#include "core/base/large_array.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <fstream>
#include <numeric>
#include <sstream>
#include <string>
#include <utility>

namespace deform::large_array_test {
namespace {

std::uintptr_t begin_of(const LargeArray<double>& array) { return reinterpret_cast<std::uintptr_t>(array.data()); }

TEST(LargeArray, BeginsAtALineAndKeepsItsValues) {
  for (const std::size_t count : {1, 100, 5000, 3'000'000}) {
    LargeArray<double> array(count);
    EXPECT_EQ(begin_of(array) % 64, 0u) << count;
    std::iota(array.begin(), array.end(), 1.0);
    LargeArray<double> copy = array, moved = std::move(array);
    EXPECT_EQ(copy, moved);
    EXPECT_EQ(copy.back(), static_cast<double>(count));
  }
}

#ifdef __linux__
/// The flags of the mapping that holds this address; empty where the kernel does not tell.
std::string flags_at(std::uintptr_t address) {
  std::ifstream maps("/proc/self/smaps");
  bool inside = false;
  for (std::string line; std::getline(maps, line);) {
    std::istringstream words(line);
    std::uintptr_t low = 0, high = 0;
    char dash = 0;
    if (words >> std::hex >> low >> dash >> high && dash == '-') inside = low <= address && address < high;
    if (inside && line.rfind("VmFlags:", 0) == 0) return line;
  }
  return {};
}

TEST(LargeArray, LargeOnesAskForHugePages) {
  if (!std::ifstream("/sys/kernel/mm/transparent_hugepage/enabled")) return;  // this kernel has none
  const LargeArray<double> large(std::size_t{3} << 20), small(1000);          // 24 MiB
  const std::string flags = flags_at(begin_of(large));
  if (flags.empty()) return;  // this kernel does not tell
  EXPECT_NE(flags.find(" hg"), std::string::npos) << flags;
  EXPECT_EQ(flags_at(begin_of(small)).find(" hg"), std::string::npos);
}
#endif

}  // namespace
}  // namespace deform::large_array_test
