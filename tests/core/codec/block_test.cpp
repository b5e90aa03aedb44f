// SPDX-License-Identifier: GPL-3.0-or-later
// Blocks: order, true error, tolerance, fall-back.
#include "core/codec/block.h"

#include <gtest/gtest.h>

#include <cstring>
#include <limits>

#include "core/base/error.h"
#include "tests/core/codec/block_fields.h"

namespace deform::codec::block_test {
namespace {

const Encoding all_encodings[] = {Encoding::raw_f64, Encoding::raw_f32, Encoding::draco, Encoding::delta_zstd};
const Encoding integer_encodings[] = {Encoding::draco, Encoding::delta_zstd};

std::string name_of(const testing::TestParamInfo<Encoding>& parameter) {
  switch (parameter.param) {
    case Encoding::raw_f64:
      return "raw_f64";
    case Encoding::raw_f32:
      return "raw_f32";
    case Encoding::draco:
      return "draco";
    case Encoding::delta_zstd:
      return "delta_zstd";
  }
  return "unknown";
}

Points decoded(const Block& block, const Points& registered) {
  Points out(registered.size());
  decode(block, registered, out);
  return out;
}

double largest_difference(const Points& a, const Points& b) {
  double largest = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (int k = 0; k < 3; ++k) largest = std::max(largest, std::fabs(a[i][k] - b[i][k]));
  }
  return largest;
}

bool same_bits(const Points& a, const Points& b) {
  return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(Vec3)) == 0);
}

class EveryEncoding : public testing::TestWithParam<Encoding> {};
INSTANTIATE_TEST_SUITE_P(Block, EveryEncoding, testing::ValuesIn(all_encodings), name_of);
class IntegerEncoding : public testing::TestWithParam<Encoding> {};
INSTANTIATE_TEST_SUITE_P(Block, IntegerEncoding, testing::ValuesIn(integer_encodings), name_of);

TEST_P(EveryEncoding, keeps_order_and_states_the_true_error) {
  const BumpField field = bump_field(20000);
  const Block block = encode(field.registered, field.deformed, {GetParam(), 1e-6 * field.diagonal});
  EXPECT_EQ(block.encoding, GetParam());
  EXPECT_FALSE(block.fell_back);
  EXPECT_EQ(block.count, 20000u);
  EXPECT_EQ(largest_difference(decoded(block, field.registered), field.deformed), block.max_error);
}

TEST_P(EveryEncoding, points_without_any_order_stay_where_they_are) {
  const BumpField field = noise_field(3001, 0.01, 7);
  const Block block = encode(field.registered, field.deformed, {GetParam(), 1e-5});
  EXPECT_EQ(block.encoding, GetParam());
  EXPECT_EQ(largest_difference(decoded(block, field.registered), field.deformed), block.max_error);
}

TEST_P(EveryEncoding, coincident_points_are_all_kept) {
  BumpField field = bump_field(100);
  for (std::size_t i = 0; i < 100; i += 2) {
    field.registered[i] = field.registered[0];
    field.deformed[i] = field.deformed[0];
  }
  field.deformed[4][1] += 0.5;  // coincident at rest, apart afterwards
  const Block block = encode(field.registered, field.deformed, {GetParam(), 1e-6});
  const Points out = decoded(block, field.registered);
  ASSERT_EQ(out.size(), 100u);
  EXPECT_EQ(largest_difference(out, field.deformed), block.max_error);
  EXPECT_LE(block.max_error, 1e-6);
}

TEST_P(EveryEncoding, empty_block) {
  const Block block = encode({}, {}, {GetParam(), 1e-6});
  EXPECT_EQ(block.count, 0u);
  EXPECT_TRUE(block.bytes.empty() || GetParam() == Encoding::delta_zstd);
  EXPECT_NO_THROW(decode(block, {}, {}));
}

TEST_P(EveryEncoding, one_to_twenty_five_points) {  // around the twelve numbers that are worked on at once
  for (std::size_t n = 1; n <= 25; ++n) {
    const BumpField field = noise_field(n, 0.1, static_cast<unsigned>(n));
    const Block block = encode(field.registered, field.deformed, {GetParam(), 1e-4});
    EXPECT_EQ(block.encoding, GetParam());
    EXPECT_EQ(largest_difference(decoded(block, field.registered), field.deformed), block.max_error) << n;
  }
}

TEST_P(EveryEncoding, the_largest_block_and_no_larger) {
  BumpField field = bump_field(max_block_points);
  const Block block = encode(field.registered, field.deformed, {GetParam(), 1e-5});
  EXPECT_EQ(largest_difference(decoded(block, field.registered), field.deformed), block.max_error);
  field = bump_field(max_block_points + 1);
  EXPECT_THROW(encode(field.registered, field.deformed, {GetParam(), 1e-5}), Error);
}

TEST_P(EveryEncoding, what_is_not_finite_comes_back_bit_for_bit) {
  for (const double odd : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(),
                           -std::numeric_limits<double>::infinity(), 1e300, std::numeric_limits<double>::max()}) {
    for (const std::size_t at : {0, 5, 12, 36}) {
      BumpField field = bump_field(37);
      field.deformed[at][at % 3] = odd;
      const Block block = encode(field.registered, field.deformed, {GetParam(), 1e-6});
      EXPECT_EQ(block.encoding, Encoding::raw_f64);
      EXPECT_EQ(block.fell_back, GetParam() != Encoding::raw_f64);
      EXPECT_TRUE(same_bits(decoded(block, field.registered), field.deformed));
    }
  }
}

TEST(Block, raw_f64_is_bit_exact) {
  BumpField field = bump_field(500);
  field.deformed[3] = {-0.0, std::numeric_limits<double>::denorm_min(), 1e308};
  const Block block = encode(field.registered, field.deformed, {Encoding::raw_f64, 0});
  EXPECT_EQ(block.max_error, 0);
  EXPECT_TRUE(same_bits(decoded(block, field.registered), field.deformed));
}

TEST(Block, raw_f32_rounds_to_the_nearest_float) {
  const BumpField field = bump_field(500);
  const Points out = decoded(encode(field.registered, field.deformed, {Encoding::raw_f32, 0}), field.registered);
  for (std::size_t i = 0; i < out.size(); ++i) {
    for (int k = 0; k < 3; ++k) EXPECT_EQ(out[i][k], static_cast<double>(static_cast<float>(field.deformed[i][k])));
  }
}

// The table of tolerances: every one is kept, including all roundings; what an encoding cannot keep falls back and says so.
TEST_P(IntegerEncoding, tolerance_is_kept) {
  for (const Vec3 origin : {Vec3{0, 0, 0}, Vec3{1000, -2000, 500}, Vec3{1e7, 1e7, 1e7}}) {
    const BumpField field = bump_field(20000, origin);
    for (const double relative : {1e-3, 1e-6, 1e-9, 1e-12, 1e-15}) {
      const double tolerance = relative * field.diagonal;
      const Block block = encode(field.registered, field.deformed, {GetParam(), tolerance});
      EXPECT_LE(block.max_error, tolerance);
      EXPECT_EQ(largest_difference(decoded(block, field.registered), field.deformed), block.max_error);
      EXPECT_EQ(block.fell_back, block.encoding == Encoding::raw_f64);
      if (origin[0] == 0 && relative >= 1e-6) {
        EXPECT_FALSE(block.fell_back) << relative;
        EXPECT_GT(block.max_error, 0.9 * tolerance) << "the grid is finer than it has to be";
      }
      if (relative <= 1e-15) {
        EXPECT_TRUE(block.fell_back) << "near the rounding of the coordinates";
      }
    }
  }
}

TEST_P(IntegerEncoding, a_nanometre_of_a_smooth_field_still_fits) {
  const BumpField field = bump_field(32768);
  const Block block = encode(field.registered, field.deformed, {GetParam(), 1e-9 * field.diagonal});
  EXPECT_FALSE(block.fell_back);
  EXPECT_LE(block.max_error, 1e-9 * field.diagonal);
}

TEST_P(IntegerEncoding, large_common_displacements_stay_small_integers) {
  BumpField field = bump_field(5000);
  for (auto& p : field.deformed) p = {p[0] + 900, p[1] - 1200, p[2] + 0.25};
  const Block block = encode(field.registered, field.deformed, {GetParam(), 1e-6});
  EXPECT_FALSE(block.fell_back);
  EXPECT_GT(std::abs(block.offset[0]), 400'000'000);
  EXPECT_LE(block.max_error, 1e-6);
  EXPECT_LT(block.bytes.size(), 5000 * sizeof(Vec3) / 3);
  EXPECT_EQ(largest_difference(decoded(block, field.registered), field.deformed), block.max_error);
}

TEST_P(IntegerEncoding, integers_beyond_the_range_fall_back) {
  const BumpField field = noise_field(1000, 1.0, 3);
  const Block block = encode(field.registered, field.deformed, {GetParam(), 1e-11});
  EXPECT_TRUE(block.fell_back);
  EXPECT_EQ(block.max_error, 0);
  EXPECT_TRUE(same_bits(decoded(block, field.registered), field.deformed));
}

TEST_P(IntegerEncoding, the_rest_position_is_exact_and_tiny) {
  const BumpField field = bump_field(10000);
  const Block block = encode(field.registered, field.registered, {GetParam(), 1e-9});
  EXPECT_EQ(block.max_error, 0);
  EXPECT_LT(block.bytes.size(), 200u);
  EXPECT_TRUE(same_bits(decoded(block, field.registered), field.registered));
}

TEST_P(IntegerEncoding, tolerance_must_be_a_positive_number) {
  const BumpField field = bump_field(4);
  for (const double bad : {0.0, -1e-6, std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    EXPECT_THROW(encode(field.registered, field.deformed, {GetParam(), bad}), Error) << bad;
  }
}

TEST_P(IntegerEncoding, extreme_tolerances_are_kept_or_fall_back) {
  const BumpField field = bump_field(50);
  for (const double tolerance : {std::numeric_limits<double>::denorm_min(), 1e-300, 1e-100, 1e3, 1e100, 1e307}) {
    const Block block = encode(field.registered, field.deformed, {GetParam(), tolerance});
    EXPECT_LE(block.max_error, tolerance);
    EXPECT_EQ(largest_difference(decoded(block, field.registered), field.deformed), block.max_error) << tolerance;
  }
}

TEST_P(EveryEncoding, is_a_pure_function) {
  const BumpField field = bump_field(3000);
  const Block a = encode(field.registered, field.deformed, {GetParam(), 1e-6});
  const Block b = encode(field.registered, field.deformed, {GetParam(), 1e-6});
  EXPECT_EQ(a.bytes, b.bytes);
  EXPECT_EQ(a.checksum, b.checksum);
}

TEST(Block, draco_and_delta_agree_on_the_integers) {
  const BumpField field = bump_field(3000);
  const Block a = encode(field.registered, field.deformed, {Encoding::draco, 1e-6});
  const Block b = encode(field.registered, field.deformed, {Encoding::delta_zstd, 1e-6});
  EXPECT_EQ(a.checksum, b.checksum);
  EXPECT_TRUE(same_bits(decoded(a, field.registered), decoded(b, field.registered)));
}

TEST(Block, checksums_are_xxh64) {
  const Block empty = encode({}, {}, {Encoding::raw_f64, 0});
  EXPECT_EQ(empty.checksum, 0xEF46DB3751D8E999u);  // of nothing, seed 0
  EXPECT_EQ(fold_checksums({}), 0xEF46DB3751D8E999u);
  const std::uint64_t parts[] = {1, 2};
  const std::uint64_t swapped[] = {2, 1};
  EXPECT_NE(fold_checksums(parts), fold_checksums(swapped));
}

TEST(Block, sizes_must_agree) {
  const BumpField field = bump_field(10);
  EXPECT_THROW(encode(std::span(field.registered).first(9), field.deformed, {Encoding::raw_f64, 0}), Error);
  const Block block = encode(field.registered, field.deformed, {Encoding::raw_f64, 0});
  Points out(9);
  EXPECT_THROW(decode(block, std::span(field.registered).first(9), out), Error);
}

}  // namespace
}  // namespace deform::codec::block_test
