// SPDX-License-Identifier: GPL-3.0-or-later
// Against libxxhash, which the wire contract names.
#include "core/compiled/checksum.h"

#include <gtest/gtest.h>
#include <xxhash.h>

#include <random>
#include <vector>

namespace deform::compiled::checksum_test {
namespace {

TEST(Checksum, IsXxh64OfEveryLength) {
  std::mt19937_64 random(1);
  std::vector<std::byte> bytes(1000);
  for (std::byte& byte : bytes) byte = static_cast<std::byte>(random());
  for (std::size_t size = 0; size <= bytes.size(); ++size) {
    EXPECT_EQ(checksum({bytes.data(), size}), XXH64(bytes.data(), size, 0)) << size;
  }
}

}  // namespace
}  // namespace deform::compiled::checksum_test
