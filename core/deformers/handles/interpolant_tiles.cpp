// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/interpolant_tiles.h"

#include <algorithm>

namespace deform {

void interpolate_tile(const Interpolator& system, const double* tile, const double* coefficients, std::size_t columns,
                      double* out) {
  std::fill_n(out, columns * tile_size, 0.0);
  interpolate_tile_columns(system, tile, coefficients, columns, columns, out);
}

void interpolate_tile_columns(const Interpolator& system, const double* tile, const double* coefficients, std::size_t ld,
                              std::size_t columns, double* out) {
  tile_kernel_sums(system.kernel(), tile, system.centres(), coefficients, ld, columns, out);
  const std::size_t q = system.polynomials().terms();
  if (q == 0) return;
  double terms[10];
  double P[10 * tile_size];
  for (std::size_t i = 0; i < tile_size; ++i) {
    system.polynomials().values({tile[i], tile[tile_size + i], tile[2 * tile_size + i]}, terms);
    for (std::size_t t = 0; t < q; ++t) P[t * tile_size + i] = terms[t];
  }
  tile_product(P, q, coefficients + system.size() * ld, ld, columns, out);
}

}  // namespace deform
