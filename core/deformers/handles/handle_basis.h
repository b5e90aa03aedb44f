// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/deformers/handles/compressed_fields.h"
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
  /// exact - stored value, estimated, at some of the points x fields, row by row; of all bases of a system at the same points.
  std::vector<double> errors{};
  std::vector<double> more{};  ///< per field: to be added for what may be worse at other points, or all that is known; or empty
  bool converged = true;       ///< false when a solution stopped above its tolerance, or a factor has no correct digits
  std::optional<CompressedFields> compressed{};  ///< in the place of the tiles, which have no points then

  /// Stores the fields to a tolerance from now on: the errors of all of them together stay within that fraction of D in a design
  /// whose handles move by D and turn by one radian. Each has the same share, the tolerance over the number of fields: the
  /// coefficients of a handle are then at most D for the field 1, and for x, y and z sqrt(12 (1 - cos 1)) < 2.4 D together.
  /// Places of the points that follow, unit coordinates.
  void compress(std::span<const Vec3> places, double tolerance, const RunContext& context);

  /// Without the errors.
  std::size_t bytes() const;
  /// About the most that a basis takes, to a tolerance or, with 0, in doubles.
  static std::size_t bytes_for(std::size_t points, std::size_t fields, double tolerance);
  /// The same while it is made: it is there in doubles before it is compressed.
  static std::size_t peak_bytes_for(std::size_t points, std::size_t fields, double tolerance);
};

/// Limits of the tolerance of a basis; 0 stands for doubles. Throws Error(invalid_argument) naming the field.
inline constexpr double least_basis_tolerance = 1e-12, largest_basis_tolerance = 1e-3;
void check_basis_tolerance(double tolerance, const std::string& field);

/// Whether a basis of so many bytes is stored beside a factor of so many.
bool wants_basis(BasisMode mode, std::size_t basis_bytes, std::size_t factor_bytes);

}  // namespace deform
