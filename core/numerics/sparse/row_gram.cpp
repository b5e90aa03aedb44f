// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/sparse/row_gram.h"

#include <algorithm>
#include <limits>
#include <numeric>

#include "core/base/parallel.h"

namespace deform {

namespace {

constexpr std::size_t gram_columns_per_range = 16;

/// Where a column has entries.
struct Places {
  std::vector<std::int64_t> starts;
  std::vector<std::int64_t> entries;
  std::vector<std::uint32_t> blocks;

  Places(const RowBlocks& rows, std::size_t columns) : starts(columns + 1, 0) {
    for (const std::uint32_t column : rows.columns) ++starts[column + 1];
    std::partial_sum(starts.begin(), starts.end(), starts.begin());
    entries.resize(rows.columns.size());
    blocks.resize(rows.columns.size());
    std::vector<std::int64_t> next(starts.begin(), starts.end() - 1);
    for (std::size_t i = 0; i < rows.blocks(); ++i) {
      for (std::int64_t e = rows.starts[i]; e < rows.starts[i + 1]; ++e) {
        const auto at = static_cast<std::size_t>(next[rows.columns[static_cast<std::size_t>(e)]]++);
        entries[at] = e;
        blocks[at] = static_cast<std::uint32_t>(i);
      }
    }
  }
};

/// One column of the lower triangle at a time; `sums` and `seen` are as long as there are columns.
struct Gatherer {
  const RowBlocks& rows;
  const Places& places;
  std::vector<double> sums;
  std::vector<char> seen;

  void gather(std::size_t j, LowerColumn& out) {
    seen[j] = 1;  // the diagonal is always there
    out.rows.push_back(static_cast<std::int64_t>(j));
    for (std::int64_t p = places.starts[j]; p < places.starts[j + 1]; ++p) {
      const std::int64_t own = places.entries[static_cast<std::size_t>(p)];
      const std::int64_t end = rows.starts[places.blocks[static_cast<std::size_t>(p)] + 1];
      const double* const a = rows.values.data() + static_cast<std::size_t>(own) * rows.height;
      for (std::int64_t e = own; e < end; ++e) {  // columns ascend: these are j and those after it
        const std::uint32_t i = rows.columns[static_cast<std::size_t>(e)];
        const double* const b = rows.values.data() + static_cast<std::size_t>(e) * rows.height;
        double product = 0;
        for (std::size_t h = 0; h < rows.height; ++h) product += a[h] * b[h];
        if (!seen[i]) {
          seen[i] = 1;
          out.rows.push_back(i);
        }
        sums[i] += product;
      }
    }
    std::sort(out.rows.begin(), out.rows.end());
    for (const std::int64_t i : out.rows) {
      out.values.push_back(sums[static_cast<std::size_t>(i)]);
      sums[static_cast<std::size_t>(i)] = 0;
      seen[static_cast<std::size_t>(i)] = 0;
    }
  }
};

}  // namespace

SparseMatrix lower_matrix(std::vector<LowerColumn>& columns) {
  SparseMatrix lower(static_cast<Eigen::Index>(columns.size()), static_cast<Eigen::Index>(columns.size()));
  std::int64_t* const starts = lower.outerIndexPtr();
  starts[0] = 0;
  for (std::size_t j = 0; j < columns.size(); ++j) starts[j + 1] = starts[j] + static_cast<std::int64_t>(columns[j].rows.size());
  lower.resizeNonZeros(starts[columns.size()]);
  for (std::size_t j = 0; j < columns.size(); ++j) {
    std::copy(columns[j].rows.begin(), columns[j].rows.end(), lower.innerIndexPtr() + starts[j]);
    std::copy(columns[j].values.begin(), columns[j].values.end(), lower.valuePtr() + starts[j]);
    columns[j] = {};
  }
  return lower;
}

SparseMatrix lower_gram(const RowBlocks& rows, std::size_t columns, const RunContext& context) {
  const Places places(rows, columns);
  std::vector<LowerColumn> gathered(columns);
  parallel_for(context, columns, gram_columns_per_range, [&](std::size_t begin, std::size_t end) {
    Gatherer gatherer{rows, places, std::vector<double>(columns, 0.0), std::vector<char>(columns, 0)};
    for (std::size_t j = begin; j < end; ++j) gatherer.gather(j, gathered[j]);
  });
  return lower_matrix(gathered);
}

std::vector<std::uint32_t> joined_columns(const RowBlocks& rows, std::size_t columns) {
  std::vector<std::uint32_t> root(columns);
  std::iota(root.begin(), root.end(), 0u);
  const auto find = [&](std::uint32_t i) {
    while (root[i] != i) i = root[i] = root[root[i]];
    return i;
  };
  for (std::size_t i = 0; i < rows.blocks(); ++i) {
    if (rows.starts[i] == rows.starts[i + 1]) continue;
    std::uint32_t first = find(rows.columns[static_cast<std::size_t>(rows.starts[i])]);
    for (std::int64_t e = rows.starts[i] + 1; e < rows.starts[i + 1]; ++e) {
      const std::uint32_t other = find(rows.columns[static_cast<std::size_t>(e)]);
      const std::uint32_t least = std::min(first, other);
      root[first] = root[other] = least;
      first = least;
    }
  }
  constexpr std::uint32_t none = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> number(columns, none), part(columns);
  std::uint32_t parts = 0;
  for (std::uint32_t j = 0; j < columns; ++j) {
    const std::uint32_t at = find(j);
    if (number[at] == none) number[at] = parts++;
    part[j] = number[at];
  }
  return part;
}

}  // namespace deform
