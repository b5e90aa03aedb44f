// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>

#include "core/numerics/interpolation/interpolator.h"
#include "core/numerics/kernels/tiles.h"

namespace deform {

/// Adds the values of interpolants at one tile of points: out[c][16] += kernel sums plus polynomials. `coefficients` has m + q
/// rows with row stride ld, of which the first `columns` columns are used.
void interpolate_tile_columns(const Interpolator& system, const double* tile, const double* coefficients, std::size_t ld,
                              std::size_t columns, double* out);
/// The same for coefficients with row stride `columns`; overwrites `out`.
void interpolate_tile(const Interpolator& system, const double* tile, const double* coefficients, std::size_t columns,
                      double* out);

}  // namespace deform
