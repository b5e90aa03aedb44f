// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/sparse/row_gram.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <random>
#include <vector>

namespace deform::row_gram_test {
namespace {

/// Blocks over a few random columns each, and the same as a full matrix.
RowBlocks random_blocks(std::size_t blocks, std::size_t height, std::size_t columns, Eigen::MatrixXd& full) {
  std::mt19937_64 random(4);
  std::uniform_real_distribution<double> even(-1, 1);
  RowBlocks rows;
  rows.height = height;
  full = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(blocks * height), static_cast<Eigen::Index>(columns));
  for (std::size_t i = 0; i < blocks; ++i) {
    for (std::size_t j = 0; j < columns; ++j) {
      if (even(random) < 0.6) continue;
      rows.columns.push_back(static_cast<std::uint32_t>(j));
      for (std::size_t h = 0; h < height; ++h) {
        rows.values.push_back(even(random));
        full(static_cast<Eigen::Index>(i * height + h), static_cast<Eigen::Index>(j)) = rows.values.back();
      }
    }
    rows.starts.push_back(static_cast<std::int64_t>(rows.columns.size()));
  }
  return rows;
}

TEST(LowerGram, IsTheProduct) {
  for (const std::size_t height : {1u, 4u, 9u}) {
    Eigen::MatrixXd full;
    const RowBlocks rows = random_blocks(30, height, 50, full);
    RunContext one, two;
    one.threads = 1;
    two.threads = 2;
    const SparseMatrix lower = lower_gram(rows, 50, one), again = lower_gram(rows, 50, two);
    const Eigen::MatrixXd expected = (full.transpose() * full).triangularView<Eigen::Lower>();
    EXPECT_LT((Eigen::MatrixXd(lower) - expected).norm(), 1e-13 * expected.norm());
    ASSERT_EQ(lower.nonZeros(), again.nonZeros());
    EXPECT_TRUE(std::equal(lower.valuePtr(), lower.valuePtr() + lower.nonZeros(), again.valuePtr()));
    for (Eigen::Index j = 0; j < 50; ++j) EXPECT_EQ(lower.innerIndexPtr()[lower.outerIndexPtr()[j]], j);
  }
}

TEST(JoinedColumns, ThoseThatShareABlock) {
  RowBlocks rows;
  for (const std::vector<std::uint32_t>& block : {std::vector<std::uint32_t>{1, 4}, {0, 3}, {}, {4, 6}, {2}}) {
    rows.columns.insert(rows.columns.end(), block.begin(), block.end());
    rows.starts.push_back(static_cast<std::int64_t>(rows.columns.size()));
  }
  EXPECT_EQ(joined_columns(rows, 7), (std::vector<std::uint32_t>{0, 1, 2, 0, 1, 3, 1}));
}

}  // namespace
}  // namespace deform::row_gram_test
