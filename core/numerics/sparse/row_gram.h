// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/numerics/sparse/sparse.h"

namespace deform {

/// A tall sparse matrix B in blocks of `height` rows with the same columns, such as the derivatives of the functions at
/// one point.
struct RowBlocks {
  std::size_t height = 1;
  std::vector<std::int64_t> starts{0};  ///< blocks + 1: block i has the entries starts[i] .. starts[i + 1]
  std::vector<std::uint32_t> columns;   ///< ascending in each block
  std::vector<double> values;           ///< `height` values for each entry

  std::size_t blocks() const { return starts.size() - 1; }
};

/// The lower triangle of B^T B, columns x columns, with all diagonal entries stored. Runs in parallel; sums are taken in the
/// order of the blocks, so the result does not depend on the number of threads.
SparseMatrix lower_gram(const RowBlocks& rows, std::size_t columns, const RunContext& context = {});

/// One column of a lower triangular matrix: rows ascending, starting with the diagonal.
struct LowerColumn {
  std::vector<std::int64_t> rows;
  std::vector<double> values;
};
/// Builds a square matrix from its columns, which are emptied.
SparseMatrix lower_matrix(std::vector<LowerColumn>& columns);

/// The connected components of the columns, where two columns are connected if they have entries in the same block. Components
/// are numbered from 0 in the order of their first columns.
std::vector<std::uint32_t> joined_columns(const RowBlocks& rows, std::size_t columns);

}  // namespace deform
