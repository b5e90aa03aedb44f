// SPDX-License-Identifier: GPL-3.0-or-later
// Bases in less memory, from codes that the test packs itself.
#include "core/compiled/coded_fields.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "core/compiled/deformation.h"
#include "core/compiled/reader.h"
#include "tests/core/compiled/contents.h"
#include "tests/support/expect_error.h"

namespace deform::compiled::coded_fields_test {
namespace {

using deform::test::expect_error;

/// Packs the 16 numbers of a column as docs/compiled.md says, bit by bit.
void pack(const std::vector<std::uint32_t>& numbers, unsigned bits, std::vector<std::uint8_t>& to) {
  const auto put = [&](std::size_t at, std::size_t bit, bool on) {
    if (on) to[at + bit / 8] = static_cast<std::uint8_t>(to[at + bit / 8] | 1u << bit % 8);
  };
  const auto plane = [&](unsigned width, unsigned shift, auto place) {
    const std::size_t at = to.size();
    to.resize(at + width * 2);
    for (std::size_t i = 0; i < 16; ++i) {
      for (unsigned b = 0; b < width; ++b) put(at, place(i) + b, (numbers[i] >> (shift + b) & 1u) != 0);
    }
  };
  if (bits == 32) return plane(32, 0, [](std::size_t i) { return 32 * i; });
  unsigned shift = 0;
  if (bits % 8 != 0) {
    plane(4, 0, [](std::size_t i) { return 8 * (i % 8) + 4 * (i / 8); });
    shift = 4;
  }
  if (bits / 8 % 2 != 0) {
    plane(8, shift, [](std::size_t i) { return 8 * i; });
    shift += 8;
  }
  if (bits >= 16) plane(16, shift, [](std::size_t i) { return 16 * i; });
}

/// Blocks with columns of every width, the second of them in doubles.
struct Coded {
  explicit Coded(std::size_t points, std::size_t fields_in = 8, std::uint64_t seed = 7) : fields(fields_in), random(seed) {
    std::uniform_real_distribution<double> uniform(-1, 1);
    for (std::size_t i = 0; i < points; ++i) places.push_back({uniform(random), uniform(random), uniform(random)});
    values.assign(basis_values(points, fields), 0.0);
    for (std::size_t first = 0; first < points; first += coded_points) {
      add(first, std::min(coded_points, points - first), first == coded_points);
    }
  }

  void add(std::size_t first, std::size_t points, bool exact) {
    std::uniform_real_distribution<double> uniform(-1, 1);
    const auto numbers = [&](std::size_t count) {
      std::vector<double> result(count);
      for (double& x : result) x = uniform(random);
      return result;
    };
    const std::size_t tiles = (points + 15) / 16;
    if (exact) {
      const std::vector<double> own = numbers(tiles * 16 * fields);
      std::copy(own.begin(), own.end(), values.begin() + static_cast<std::ptrdiff_t>(first * fields));
      CodedBlock block;
      block.exact = own;
      return append_block(block, fields, bytes);
    }
    const std::vector<std::uint8_t> bits{0, 4, 8, 12, 16, 20, 24, 28, 32};
    const std::size_t columns = bits.size(), stride = 12;
    const std::vector<double> affine = numbers(4 * fields), steps = numbers(columns), offsets = numbers(columns);
    std::vector<float> directions(fields * stride);
    for (float& x : directions) x = static_cast<float>(uniform(random));
    const Vec3 centre{0.1, 0.2, 0.3};
    std::vector<std::uint8_t> codes;
    std::vector<std::vector<std::uint32_t>> code(columns, std::vector<std::uint32_t>(16));
    for (std::size_t t = 0; t < tiles; ++t) {
      for (std::size_t k = 0; k < columns; ++k) {
        for (std::uint32_t& c : code[k]) c = bits[k] == 0 ? 0 : static_cast<std::uint32_t>(random()) >> (32 - bits[k]);
        pack(code[k], bits[k], codes);
      }
      for (std::size_t i = 0; i < 16 && 16 * t + i < points; ++i) {
        const Vec3& place = places[first + 16 * t + i];
        for (std::size_t f = 0; f < fields; ++f) {
          long double sum = affine[4 * f];
          for (std::size_t c = 0; c < 3; ++c) sum += affine[4 * f + c + 1] * ((long double){place[c]} - centre[c]) * 0.5L;
          for (std::size_t k = 0; k < columns; ++k) {
            sum += (offsets[k] + (long double){steps[k]} * code[k][i]) * directions[f * stride + k];
          }
          values[(first / 16 + t) * fields * 16 + f * 16 + i] = static_cast<double>(sum);
        }
      }
    }
    append_block({centre, 0.5, affine, steps, offsets, bits, directions, stride, codes, {}}, fields, bytes);
  }

  std::size_t fields;
  std::mt19937_64 random;
  std::vector<Vec3> places;
  std::vector<std::byte> bytes;
  std::vector<double> values;
};

TEST(CodedFields, AreTheValuesThatTheyStandFor) {
  for (const std::size_t points : {1u, 16u, 500u, 512u, 1030u, 2000u}) {
    const Coded coded(points);
    const std::vector<double> values = decoded_fields(coded.bytes, coded.places, coded.fields);
    ASSERT_EQ(values.size(), coded.values.size());
    for (std::size_t s = 0; s < points; ++s) {
      for (std::size_t f = 0; f < coded.fields; ++f) {
        const std::size_t j = (s / 16 * coded.fields + f) * 16 + s % 16;
        EXPECT_NEAR(values[j], coded.values[j], 1e-13 * 0x1p32) << points << " points, point " << s << ", field " << f;
      }
    }
  }
}

TEST(CodedFields, SmallCodesKeepTheirDigits) {
  // Without the columns of many bits the values are of order 1.
  const std::vector<double> affine{1, 2, 3, 4}, steps{0.25}, offsets{-1};
  const std::vector<std::uint8_t> bits{4};
  const std::vector<float> directions{2};
  std::vector<std::uint8_t> codes;
  pack({0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15}, 4, codes);
  std::vector<std::byte> bytes;
  append_block({{0, 0, 0}, 1, affine, steps, offsets, bits, directions, 1, codes, {}}, 1, bytes);
  std::vector<Vec3> places;
  for (int i = 0; i < 16; ++i) places.push_back({0.5 * i, 1, -1});
  const std::vector<double> values = decoded_fields(bytes, places, 1);
  for (int i = 0; i < 16; ++i) EXPECT_EQ(values[static_cast<std::size_t>(i)], 1 + 2 * 0.5 * i + 3 - 4 + 2 * (-1 + 0.25 * i)) << i;
}

TEST(CodedFields, RefusesBytesThatAreNone) {
  const Coded coded(1030);
  for (std::size_t size = 0; size < coded.bytes.size(); size += 501) {
    expect_error(ErrorCode::data_loss, {"CODE"},
                 [&] { decoded_fields(std::span(coded.bytes).first(size), coded.places, coded.fields); });
  }
  std::vector<std::byte> longer = coded.bytes;
  longer.resize(longer.size() + 8);
  expect_error(ErrorCode::data_loss, {"more bytes"}, [&] { decoded_fields(longer, coded.places, coded.fields); });
  const std::vector<Vec3> many(1u << 20);
  expect_error(ErrorCode::data_loss, {"too few for 1048576 points"}, [&] { decoded_fields(coded.bytes, many, coded.fields); });
  // The widths stand behind everything else but the codes of the first block.
  std::vector<std::byte> wrong = coded.bytes;
  const std::size_t widths = 8 + 32 + 4 * 8 * coded.fields + 2 * 9 * 8 + 4 * 9 * coded.fields;
  ASSERT_EQ(wrong[widths + 8], std::byte{32});
  for (const unsigned bits : {3u, 36u}) {
    wrong[widths + 8] = static_cast<std::byte>(bits);
    expect_error(ErrorCode::data_loss, {"block 0", "bits"}, [&] { decoded_fields(wrong, coded.places, coded.fields); });
  }
}

TEST(CodedFields, AreReadFromAFile) {
  test::Blend blend(2000);
  const std::vector<Vec3> places = following_places(blend.content);
  Coded coded(places.size(), blend.content.fields());
  const std::vector<double> values = decoded_fields(coded.bytes, places, coded.fields);
  blend.content.bases[0].codes = coded.bytes;
  blend.content.bases[0].values.clear();
  const std::vector<std::byte> file = test::file_of(blend.content);
  EXPECT_EQ(read_content(file).bases[0].values, values);
}

}  // namespace
}  // namespace deform::compiled::coded_fields_test
