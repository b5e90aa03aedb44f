// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace deform::compiled {

// Sums over the fields of a basis at one tile of 16 points. Products are fused with the sums they are added to, so that there is
// one rounding per term, on every machine: the results have the same bits everywhere.

/// out[c][16] = sum over the named rows r, in their order, of tile[r][16] * B[r][c]; B has row stride ldb.
void field_sums(const double* tile, std::span<const std::uint32_t> rows, const double* B, std::size_t ldb, std::size_t columns,
                double* out);

/// sums[r][c][16] += tile[r][16] * X[c][16] for three columns c.
void add_products(const double* tile, std::size_t fields, const double* X, double* sums);

}  // namespace deform::compiled
