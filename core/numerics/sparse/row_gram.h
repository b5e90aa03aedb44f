// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/numerics/sparse/sparse.h"

namespace deform {

/// Rows of a tall sparse matrix B in blocks of `height` that share their columns: derivatives of the functions around a point.
struct RowBlocks {
  std::size_t height = 1;
  std::vector<std::int64_t> starts{0};  ///< blocks + 1: the entries of block i are starts[i] .. starts[i + 1]
  std::vector<std::uint32_t> columns;   ///< ascending in each block
  std::vector<double> values;           ///< `height` per entry

  std::size_t blocks() const { return starts.size() - 1; }
};

/// The lower triangle of B^T B, columns x columns, with the whole diagonal, in parallel; every sum in the order of the blocks, so
/// the same for any number of threads.
SparseMatrix lower_gram(const RowBlocks& rows, std::size_t columns, const RunContext& context = {});

/// One column of a lower triangle: rows ascending, from the diagonal on.
struct LowerColumn {
  std::vector<std::int64_t> rows;
  std::vector<double> values;
};
/// A square matrix from its columns, which are emptied.
SparseMatrix lower_matrix(std::vector<LowerColumn>& columns);

/// Which columns hang together: two that have entries in the same block have the same number, counted from 0 in the order of the
/// columns.
std::vector<std::uint32_t> joined_columns(const RowBlocks& rows, std::size_t columns);

}  // namespace deform
