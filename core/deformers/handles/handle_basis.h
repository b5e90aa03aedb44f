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
#include "core/deformers/handles/motion_warnings.h"
#include "core/deformers/setup.h"

namespace deform {

/// The handle basis of thesis 4.2 (eq. 4.1): the values at the following points (d x 4H) for the fields 1, x, y, z of each of
/// H handles.
struct HandleBasis {
  /// The components of the displacement, in the frame of the symmetry planes, to which these values apply.
  std::vector<std::size_t> components;
  FieldTiles tiles;
  std::vector<double> residuals;  ///< largest |value - prescribed value| of each field over the handle and fixed points
  /// What `errors` are: estimates of exact - stored values at following points, or prescribed - actual values at handle and fixed
  /// points. The latter give the misfit of a design, which is far less than `residuals` where its handles move together.
  enum class Checked { following, held };
  Checked checked = Checked::following;
  static constexpr std::size_t most_held = 256;  ///< handle and fixed points at which errors are kept
  /// Checked points x fields, row-major. All bases of a system use the same points.
  std::vector<double> errors{};
  /// For each field an allowance for larger errors at other points, or the whole error if nothing else is known; may be empty.
  std::vector<double> more{};
  bool converged = true;                         ///< false if a solution missed its tolerance or a factor has no correct digits
  std::optional<CompressedFields> compressed{};  ///< replaces `tiles`, which have no points then
  /// With a sector: whether the values apply to coefficients that are turned by a right angle about the axis, (0, -c2, c1)
  /// instead of (c0, c1, c2). Such a basis is zero at the points of handles; it adds to the one of the same components.
  bool turned = false;

  /// Compresses the fields: the error of all of them together is at most `tolerance` D in a design whose handles move by D and
  /// rotate by one radian. Each field has the same share, the tolerance over the number of fields, because the coefficients of a
  /// handle are then at most D for the field 1, and sqrt(12 (1 - cos 1)) < 2.4 D for x, y and z together. `places` are the
  /// following points in unit coordinates.
  void compress(std::span<const Vec3> places, double tolerance, const RunContext& context);

  /// Memory in bytes, without the errors.
  std::size_t bytes() const;
  /// An approximate upper bound of the memory of a basis with this tolerance, or in doubles if it is 0.
  static std::size_t bytes_for(std::size_t points, std::size_t fields, double tolerance);
  /// The same for the peak while it is computed; it exists in doubles before it is compressed.
  static std::size_t peak_bytes_for(std::size_t points, std::size_t fields, double tolerance);
};

/// The length of a unit of the solution's coordinates: of the bounding box of the mesh.
enum class UnitLength { longest_edge, diagonal };

/// What tells the designs of a method that come from its handle basis from those of others: enough to evaluate and report them
/// without the rest of its system (see restored_system.h).
struct BasisTraits {
  HandleMode handles = HandleMode::hard;
  UnitLength unit = UnitLength::diagonal;
  bool may_crack = false;  ///< coincident handle and fixed points may separate
  SharedMotions motions{};
};

/// The limits of the tolerance of a basis; 0 means doubles. check_basis_tolerance() is a check of `problems` under the name of
/// the field.
inline constexpr double least_basis_tolerance = 1e-12, largest_basis_tolerance = 1e-3;
void check_basis_tolerance(Problems& problems, double tolerance, const std::string& field);

/// Whether a basis of this size is stored in addition to a factor of this size, in bytes.
bool wants_basis(BasisMode mode, std::size_t basis_bytes, std::size_t factor_bytes);

}  // namespace deform
