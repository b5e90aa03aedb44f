// SPDX-License-Identifier: GPL-3.0-or-later
// What decoders do with bytes that no encoder made: an error, with bounded memory, and never a wrong answer without one.
#include <gtest/gtest.h>
#include <zstd.h>

#include <cstring>
#include <functional>
#include <vector>

#include "core/base/error.h"
#include "core/codec/block.h"
#include "tests/core/codec/block_fields.h"

namespace deform::codec::hostile_block_test {
namespace {

Points decoded(const Block& block, const Points& registered) {
  Points out(registered.size());
  decode(block, registered, out);
  return out;
}

void expect_data_loss(const Block& block, const Points& registered, const std::string& what) {
  try {
    decoded(block, registered);
    ADD_FAILURE() << what << ": was accepted";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::data_loss) << what << ": " << error.what();
  }
}

/// Decoding either fails with data_loss or gives exactly the right points.
void expect_no_wrong_answer(const Block& block, const BumpField& field, const Points& right, const std::string& what) {
  try {
    const Points out = decoded(block, field.registered);
    EXPECT_EQ(std::memcmp(out.data(), right.data(), right.size() * sizeof(Vec3)), 0) << what << ": a wrong answer was accepted";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::data_loss) << what;
  }
}

class HostileEveryEncoding : public testing::TestWithParam<Encoding> {
 protected:
  BumpField field = bump_field(120);
  Block good = encode(field.registered, field.deformed, {GetParam(), 1e-5});
};
INSTANTIATE_TEST_SUITE_P(HostileBlock, HostileEveryEncoding,
                         testing::Values(Encoding::raw_f64, Encoding::raw_f32, Encoding::draco, Encoding::delta_zstd),
                         [](const auto& p) { return "encoding_" + std::to_string(static_cast<int>(p.param)); });

TEST_P(HostileEveryEncoding, every_flipped_bit_is_noticed_or_harmless) {
  const Points right = decoded(good, field.registered);
  for (std::size_t i = 0; i < good.bytes.size(); ++i) {
    for (int bit = 0; bit < 8; ++bit) {
      Block bad = good;
      bad.bytes[i] = static_cast<char>(bad.bytes[i] ^ (1 << bit));
      expect_no_wrong_answer(bad, field, right, "byte " + std::to_string(i) + " bit " + std::to_string(bit));
    }
  }
}

TEST_P(HostileEveryEncoding, every_truncation_is_refused) {
  for (std::size_t size = 0; size < good.bytes.size(); ++size) {
    Block bad = good;
    bad.bytes.resize(size);
    expect_no_wrong_answer(bad, field, decoded(good, field.registered), "size " + std::to_string(size));
  }
  Block empty = good;
  empty.bytes.clear();
  expect_data_loss(empty, field.registered, "no bytes");
}

TEST_P(HostileEveryEncoding, claims_that_do_not_fit_are_refused) {
  const std::vector<std::pair<const char*, std::function<void(Block&)>>> table = {
      {"more points than the geometry", [](Block& b) { b.count += 1; }},
      {"no points", [](Block& b) { b.count = 0; }},
      {"four billion points", [](Block& b) { b.count = 0xffffffffu; }},
      {"another checksum", [](Block& b) { b.checksum ^= 1; }},
      {"an unknown encoding", [](Block& b) { b.encoding = static_cast<Encoding>(77); }},
      {"encoding 0", [](Block& b) { b.encoding = static_cast<Encoding>(0); }},
  };
  for (const auto& [what, spoil] : table) {
    Block bad = good;
    spoil(bad);
    expect_data_loss(bad, field.registered, what);
  }
}

TEST_P(HostileEveryEncoding, every_byte_of_another_encoding_is_refused) {
  for (const Encoding other : {Encoding::raw_f64, Encoding::raw_f32, Encoding::draco, Encoding::delta_zstd}) {
    if (other == GetParam()) continue;
    Block bad = good;
    bad.encoding = other;
    expect_data_loss(bad, field.registered, "encoding " + std::to_string(static_cast<int>(other)));
  }
}

class HostileIntegerEncoding : public HostileEveryEncoding {};
INSTANTIATE_TEST_SUITE_P(HostileBlock, HostileIntegerEncoding, testing::Values(Encoding::draco, Encoding::delta_zstd));

TEST_P(HostileIntegerEncoding, step_and_offset_are_checked) {
  for (const double step : {0.0, -1e-5, std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(),
                            std::numeric_limits<double>::denorm_min()}) {
    Block bad = good;
    bad.step = step;
    expect_data_loss(bad, field.registered, "step " + std::to_string(step));
  }
  for (const std::int64_t offset : {std::numeric_limits<std::int64_t>::min(), std::numeric_limits<std::int64_t>::max()}) {
    Block bad = good;
    bad.offset[1] = offset;
    expect_data_loss(bad, field.registered, "offset");
  }
}

TEST_P(HostileIntegerEncoding, random_bytes_are_refused) {
  std::mt19937 random(11);
  for (int round = 0; round < 2000; ++round) {
    Block bad = good;
    bad.bytes.resize(random() % 300);
    for (auto& byte : bad.bytes) byte = static_cast<char>(random());
    expect_data_loss(bad, field.registered, "round " + std::to_string(round));
  }
}

// Draco's decoder allocates what the header claims, so every claim is spoiled in turn behind a good beginning.
TEST(HostileBlock, draco_header_fields) {
  const BumpField field = bump_field(120);
  const Block good = encode(field.registered, field.deformed, {Encoding::draco, 1e-5});
  ASSERT_EQ(good.bytes.substr(0, 5), "DRACO");
  // magic, versions, type, method, flags, points, coders, attributes, type, data type, components, normalized, id, coder,
  // prediction, transform, compressed, scheme
  constexpr std::size_t header = 5 + 2 + 2 + 2 + 4 + 1 + 1 + 4 + 1 + 1 + 2 + 1 + 1;
  ASSERT_GT(good.bytes.size(), header);
  for (std::size_t i = 0; i < header; ++i) {
    for (const unsigned char value : {0x00, 0x01, 0x7f, 0x80, 0xff}) {
      if (static_cast<unsigned char>(good.bytes[i]) == value) continue;
      Block bad = good;
      bad.bytes[i] = static_cast<char>(value);
      expect_data_loss(bad, field.registered, "header byte " + std::to_string(i) + " = " + std::to_string(value));
    }
  }
}

TEST(HostileBlock, draco_may_not_claim_more_points_than_the_block) {
  const BumpField large = bump_field(5000);
  const BumpField small = bump_field(120);
  Block bad = encode(large.registered, large.deformed, {Encoding::draco, 1e-5});
  bad.count = 120;
  expect_data_loss(bad, small.registered, "5000 points in a block of 120");
}

TEST(HostileBlock, draco_symbol_table_is_bounded) {
  const BumpField field = bump_field(5000);
  Block bad = encode(field.registered, field.deformed, {Encoding::draco, 1e-3});
  constexpr std::size_t symbols = 5 + 2 + 2 + 2 + 4 + 1 + 1 + 4 + 1 + 1 + 2 + 1 + 1 + 1;  // after the bit length
  ASSERT_EQ(bad.bytes[symbols - 2], 1) << "the raw symbol scheme";
  bad.bytes.replace(symbols, 1, "\xff\xff\xff\xff\x0f");  // four billion
  bad.bytes.resize(1u << 20, '\x7f');                     // enough bytes to make the claim look possible
  expect_data_loss(bad, field.registered, "four billion symbols");
}

TEST(HostileBlock, zstd_frames_of_another_size) {
  const BumpField field = bump_field(120);
  const Block good = encode(field.registered, field.deformed, {Encoding::delta_zstd, 1e-5});
  const auto frame = [](std::size_t size) {
    const std::string zeros(size, '\0');
    std::string bytes(ZSTD_compressBound(size), '\0');
    bytes.resize(ZSTD_compress(bytes.data(), bytes.size(), zeros.data(), size, 1));
    return bytes;
  };
  for (const std::size_t size : {std::size_t{0}, std::size_t{120 * 12 - 1}, std::size_t{120 * 12 + 1}, std::size_t{50'000'000}}) {
    Block bad = good;
    bad.bytes = frame(size);
    expect_data_loss(bad, field.registered, "frame of " + std::to_string(size));
  }
  Block twice = good;
  twice.bytes += good.bytes;
  expect_data_loss(twice, field.registered, "two frames");
}

}  // namespace
}  // namespace deform::codec::hostile_block_test
