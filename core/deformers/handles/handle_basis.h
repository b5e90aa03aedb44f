// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <vector>

#include "core/deformers/handles/field_tiles.h"
#include "core/deformers/setup.h"

namespace deform {

/// The handle basis of thesis 4.2 (eq. 4.1): the values at the points that follow (d x 4H) for the fields 1, x, y, z of every
/// handle.
struct HandleBasis {
  /// Of the displacement, in the frame of the symmetry planes: those that have these values.
  std::vector<std::size_t> components;
  FieldTiles tiles;
  std::vector<double> residuals;  ///< per field: largest |value - prescribed value| over the handle and fixed points
  bool converged = true;          ///< false when a solution stopped above its tolerance

  std::size_t bytes() const { return tiles.bytes() + residuals.size() * sizeof(double); }
  static std::size_t bytes_for(std::size_t points, std::size_t fields) {
    return FieldTiles::bytes_for(points, fields) + fields * sizeof(double);
  }
};

/// Whether a basis of so many bytes is stored beside a factor of so many.
bool wants_basis(BasisMode mode, std::size_t basis_bytes, std::size_t factor_bytes);

}  // namespace deform
