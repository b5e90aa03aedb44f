// SPDX-License-Identifier: GPL-3.0-or-later
// Columns of integers and products of float rows on every instruction set of this machine.
#include "core/numerics/kernels/coded_tiles.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "tests/core/numerics/every_target.h"
#include "tests/core/numerics/random_points.h"

namespace deform::coded_tiles_test {
namespace {

TEST(CodedTiles, AsManyBitsAsTheLargestNumberNeeds) {
  EXPECT_EQ(code_bits(0), 0u);
  EXPECT_EQ(code_bits(1), 4u);
  for (unsigned bits = 4; bits < 32; bits += 4) {
    EXPECT_EQ(code_bits((1u << bits) - 1), bits);
    EXPECT_EQ(code_bits(1u << bits), bits + 4);
  }
  EXPECT_EQ(code_bits(largest_code), 32u);
}

/// Columns of every width, with their codes.
struct Coded {
  std::vector<std::uint8_t> bits{32, 4, 8, 12, 0, 16, 20, 24, 28, 4, 32, 28}, codes;
  std::vector<std::uint32_t> values;

  Coded() {
    std::mt19937 random(1);
    std::size_t bytes = 0;
    for (const unsigned width : bits) {
      const std::uint32_t most = width == 32 ? largest_code : (1u << width) - 1;
      for (std::size_t i = 0; i < tile_size; ++i) values.push_back(i == 3 ? most : i == 9 ? 0 : random() & most);
      bytes += coded_bytes(width);
    }
    codes.assign(bytes, 0xee);
    std::uint8_t* to = codes.data();
    for (std::size_t c = 0; c < bits.size(); ++c) {
      encode_column(values.data() + c * tile_size, bits[c], to);
      to += coded_bytes(bits[c]);
    }
  }
};

TEST(CodedTiles, ColumnsOfEveryWidthComeBack) {
  const Coded coded;
  const auto& values = coded.values;
  test::on_every_target([&] {
    std::vector<double> decoded(values.size(), -1);
    decode_columns(coded.codes.data(), coded.bits, decoded.data());
    for (std::size_t i = 0; i < values.size(); ++i) {
      EXPECT_EQ(decoded[i], values[i]) << "column " << i / tile_size << " of " << int{coded.bits[i / tile_size]} << " bits";
    }
  });
}

TEST(CodedTiles, ProductsHaveTheBitsOfThoseOfDecodedColumns) {
  const Coded coded;
  const std::vector<double> numbers(coded.values.begin(), coded.values.end());
  constexpr std::size_t ldb = 5;
  const auto B = test::random_values(coded.bits.size() * ldb, 4);
  const auto start = test::random_values(3 * tile_size, 5);
  test::on_every_target([&] {
    std::vector<double> out = start, expected = start;
    add_coded_products(coded.codes.data(), coded.bits, B.data() + 1, ldb, out.data());
    tile_product(numbers.data(), coded.bits.size(), B.data() + 1, ldb, 3, expected.data());
    EXPECT_TRUE(out == expected);
    EXPECT_TRUE(out != start);
  });
}

TEST(CodedTiles, WeightedRowsAgainstPlainLoops) {
  constexpr std::size_t rows = 9;
  const std::vector<std::uint32_t> chosen{0, 3, 4, 8};
  for (const std::size_t stride : {4, 8, 20}) {
    for (const std::size_t columns : {1, 2, 3, 7, 45}) {
      std::vector<float> A;
      for (const double value : test::random_values(rows * stride, 2)) A.push_back(static_cast<float>(value));
      const auto B = test::random_values(rows * columns, 3);
      test::on_every_target([&] {
        std::vector<double> out(columns * stride, 0.25);
        add_weighted_rows(A.data(), stride, chosen, B.data(), columns, columns, out.data());
        std::vector<double> one(stride, 0.25);
        add_weighted_rows(A.data(), stride, chosen, B.data() + columns - 1, columns, 1, one.data());
        for (std::size_t c = 0; c < columns; ++c) {
          for (std::size_t k = 0; k < stride; ++k) {
            double sum = 0.25;
            for (const std::uint32_t r : chosen) sum += static_cast<double>(A[r * stride + k]) * B[r * columns + c];
            EXPECT_NEAR(out[c * stride + k], sum, 1e-14);
            if (c + 1 == columns) {
              EXPECT_EQ(out[c * stride + k], one[k]) << "depends on the grouping";
            }
          }
        }
      });
    }
  }
}

}  // namespace
}  // namespace deform::coded_tiles_test
