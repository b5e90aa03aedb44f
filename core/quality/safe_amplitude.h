// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <variant>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/mesh/cells.h"
#include "core/mesh/elements.h"
#include "core/mesh/mesh.h"
#include "core/quality/displacement_fields.h"
#include "core/quality/extreme.h"

namespace deform {

/// The cells of a mesh that must not be inverted; borrowed. For a Mesh these are its faces: triangles and quads in a plane z =
/// constant (2D).
using CellSet = std::variant<const Elements*, const PolyhedralCells*, const Mesh*>;

/// Cells that are inverted or nearly inverted.
///
/// The normalized determinant of a cell is in [-1, 1] and positive unless the cell is inverted (or collapsed up to rounding):
///  - elements: the scaled Jacobian of ElementQuality. An element is inverted if the determinant of the edges at a corner, or for
///    quadratic elements that of their map at a node, is not positive. Points between the nodes are not checked, even if the map
///    is not affine.
///  - polyhedral cells: the errors of checkMesh, by the formulas of PolyhedralQuality. The determinant is the minimum over the
///    faces of the cosine between the outward area vector and the vector from the centre of the cell to that of the face, which
///    has the sign of the pyramid of the face. If the volume is not positive, it is the volume over the sum of |area| |vector|.
///    A cell is inverted if its volume or a pyramid is not positive; checkMesh accepts pyramids down to -1e-15, but here a
///    collapsed one counts.
///  - faces in the plane: the minimum of the sines of the corners. A face is inverted if the signed area at a corner is not
///    positive.
/// Left-handed cells, that is all cells of a mesh or of a block of it with nodes in mirrored order (clockwise faces in the plane,
/// polyhedra with faces oriented inwards), are measured as their mirror images: only a change of sign counts. "Not positive" is
/// meant up to rounding: determinants of at most 1e-14 of the product of their lengths (polyhedra: 1e-13 of areas times the size
/// of the cell) count as collapsed, so a borderline cell counts as inverted.
struct Inversions {
  std::size_t count = 0;  ///< number of inverted cells
  /// Inverted polyhedra by the failed check: the volume, or if it is positive a pyramid.
  std::size_t without_volume = 0;
  std::size_t wrong_pyramid = 0;  ///< with a positive volume
  std::vector<Extreme> worst;     ///< the inverted cells of least normalized determinant, worst first, at most 100
  /// Smallest normalized determinant of all checked cells and the cell that has it; 1 without cells.
  Extreme least_determinant{1, 0};
};

/// The safe fraction of a motion from X to Y.
struct SafeAmplitude {
  /// t*: the largest t in [0, 1] such that no cell is inverted at X + s (Y - X) for all s in [0, t).
  /// It is 1 if no cell is inverted anywhere on the path, both ends included, less than 1 if one is inverted at Y, and 0 only if
  /// a cell that is not excluded is inverted at X.
  double amplitude = 1;
  std::optional<std::size_t> first_cell;  ///< inverted from there on; the one with the smallest id; none if the amplitude is 1
  Inversions inverted;                    ///< at Y, without the excluded cells
  /// The number of cells that bounds do not prove to be safe, so that their roots were computed.
  std::size_t suspects = 0;
};

/// Checks many motions of one mesh for inversions. Cells that are inverted in its rest position are reported by at_rest() and
/// excluded from all other results, because they would make every amplitude 0.
///
/// Accuracy: determinants of elements and areas of faces are cubic and quadratic polynomials of s; their first roots are found by
/// bisection to the last bit, for any multiplicity. So a cell that only touches zero counts, with a root that is early by the
/// effect of the tolerance above (1e-7 for a double root). Centres of polyhedral cells and faces are not polynomials; here
/// intervals of s are bisected until Taylor models of the measures prove their sign or the interval is 1e-12 of s.
/// Amplitudes are never too large. The points X + s (Y - X) are meant without rounding.
///
/// Speed: the tolerance of each cell is computed once from its rest shape, and for moderate motions a bound of its deformation
/// proves for most cells that they are not inverted (quality::MotionCertificate). Only the other cells, the suspects, and those
/// that may have the smallest determinant are checked as above. Where the motion is a combination of known fields, most cells
/// are cleared by their coefficients alone, without a look at the points (quality::FieldBounds). The results are the same.
///
/// Immutable; any thread may call. The cells must outlive it.
/// Source: thesis 7.4 (inversions of elements under deformation).
class InversionCheck {
 public:
  /// rest: n x 3. Throws Error(invalid_argument): no cells, ids out of range, coordinates that are not finite, faces of another
  /// degree or not in a plane z = constant; cancelled, deadline_exceeded.
  InversionCheck(std::span<const Vec3> rest, const CellSet& cells, const RunContext& context = {});
  /// Also prepares for motions that are combinations of these fields, which are not needed afterwards.
  InversionCheck(std::span<const Vec3> rest, const CellSet& cells, const DisplacementFields& fields,
                 const RunContext& context = {});
  ~InversionCheck();
  InversionCheck(InversionCheck&&) noexcept;             ///< the other one is empty then
  InversionCheck& operator=(InversionCheck&&) noexcept;  ///< as the constructor

  std::size_t cell_count() const;  ///< number of cells
  /// The number of fields of the constructor, 0 without them.
  std::size_t fields() const;
  /// The excluded cells; the smallest determinant is over all cells.
  const Inversions& at_rest() const;
  /// The number of left-handed cells.
  std::size_t left_handed() const;

  /// The checks take points of size n x 3, run in parallel, and do not depend on the number of threads. They throw
  /// Error(invalid_argument) for a wrong number of points, coordinates that are not finite and, for a 2D mesh, points off the
  /// plane; cancelled, deadline_exceeded.
  Inversions inverted(std::span<const Vec3> points, const RunContext& context = {}) const;
  /// The number of cells with a normalized determinant of at least `margin` at `rest` and less at `points`.
  std::size_t below(double margin, std::span<const Vec3> rest, std::span<const Vec3> points,
                    const RunContext& context = {}) const;
  /// The safe fraction of a motion between two places.
  SafeAmplitude amplitude(std::span<const Vec3> from, std::span<const Vec3> to, const RunContext& context = {}) const;
  /// The same from rest to points that are those of a motion of the fields of the constructor, within its bounds, which is
  /// not checked because most points are not looked at. For volume cells only: that faces stay in their plane is not checked
  /// either. Throws Error(invalid_argument) for another number of fields or points and points that are not finite.
  SafeAmplitude amplitude(std::span<const Vec3> to, const FieldMotion& motion, const RunContext& context = {}) const;

  /// An upper bound of the memory in bytes for these cells, including that of a call. `points` is the number of points of
  /// the mesh, `fields` that of its displacement fields.
  static std::size_t bytes_for(const CellSet& cells, std::size_t points, std::size_t fields = 0);
  /// An upper bound of the peak memory of the construction.
  static std::size_t bytes_to_make(const CellSet& cells, std::size_t points, std::size_t fields = 0);

 private:
  class Impl;
  std::unique_ptr<const Impl> impl_;
};

/// The result for a single motion; at_rest are the cells inverted at X, which are excluded from the rest.
struct MotionSafety : SafeAmplitude {
  Inversions at_rest;  ///< the excluded cells
};
MotionSafety safe_amplitude(std::span<const Vec3> X, std::span<const Vec3> Y, const CellSet& cells,
                            const RunContext& context = {});

/// Finds the left-handed cells: one entry for each cell, or empty if there are none. Cells connected by sides around which the
/// nodes of both run in opposite directions form a block, which is left-handed if most of its cells are (see
/// quality::left_handed_cells()). Throws the errors of the constructor of InversionCheck for cells.
std::vector<char> left_handed_cells(std::span<const Vec3> points, const CellSet& cells, const RunContext& context = {});

/// The cells of a mesh that can be inverted, borrowed from it: its volume cells, or the faces of a 2D mesh of triangles and
/// quads. std::nullopt if there are none.
std::optional<CellSet> cell_set(const Mesh& mesh);

/// Whether all points have the same z, up to 1e-9 of the diagonal of their bounding box.
bool in_one_plane(std::span<const Vec3> points);

}  // namespace deform
