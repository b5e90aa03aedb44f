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
#include "core/quality/extreme.h"

namespace deform {

/// What of a mesh must not turn inside out; borrowed. Of a Mesh its faces are the cells: triangles and quads in a plane
/// z = constant (2D).
using CellSet = std::variant<const Elements*, const PolyhedralCells*, const Mesh*>;

/// Cells that are inverted, or about to be.
///
/// Normalized determinant of a cell, in [-1, 1], positive unless the cell is inverted (or collapsed up to rounding):
///  - elements: the scaled Jacobian of ElementQuality. Inverted: the determinant of the edges at a corner, of quadratic elements
///    that of their map at a node, is not positive. Between the nodes of elements whose map is not affine nobody looks.
///  - polyhedral cells: what checkMesh calls errors, by the formulas of PolyhedralQuality. The least cosine, over the faces,
///    between outward area vector and the way from the cell's centre to the face's (its sign is that of the face's pyramid);
///    where the volume is not positive, that over the sum of |area| |way| instead. Inverted: volume or a pyramid is not positive;
///    checkMesh lets pyramids down to -1e-15 pass, here a collapsed one does not.
///  - faces in the plane: the least sine of a corner. Inverted: the signed area of a corner is not positive.
/// Left-handed cells, which are all the cells of a mesh or of a block of it whose nodes stand in mirrored order (clockwise faces
/// in the plane, polyhedra whose faces look inwards), are measured as in a mirror: what counts is the change of sign. "Not
/// positive" is meant up to rounding: determinants at most 1e-14 of the product of their lengths (polyhedra: 1e-13 of areas times
/// the size of the cell) count as collapsed, so a cell at the brink is rather called inverted.
struct Inversions {
  std::size_t count = 0;
  /// The check that failed, of the inverted polyhedra: that of the volume, or where it is positive that of a pyramid.
  std::size_t without_volume = 0, wrong_pyramid = 0;
  std::vector<Extreme> worst;  ///< the inverted cells of least normalized determinant, worst first, at most 100
  /// Of all cells looked at, and which one has it; 1 without any.
  Extreme least_determinant{1, 0};
};

/// How much of a motion a mesh bears.
struct SafeAmplitude {
  /// t*: the largest t in [0, 1] such that no cell is inverted at X + s (Y - X) for all s in [0, t).
  /// 1: none is anywhere on the way, both ends included. Less than 1 whenever one is inverted at Y.
  /// 0: only where a cell that is not excluded is inverted at X.
  double amplitude = 1;
  std::optional<std::size_t> first_cell;  ///< that is inverted from there on; the smallest id; none when the amplitude is 1
  Inversions inverted;                    ///< at Y; without the cells excluded
  /// How many cells may be inverted on the way as far as bounds can tell, so that their roots were looked at.
  std::size_t suspects = 0;
};

/// Answers for many motions of one mesh. Cells that are inverted in its rest position are named and left out of everything else:
/// they would make every amplitude 0.
///
/// Exact: determinants of elements and areas of faces are cubic and quadratic polynomials of s, their first roots are found by
/// halving to the last bit, whatever their multiplicity; so a cell that only touches zero counts, its root early by as much as
/// the tolerance above is felt (1e-7 for a double root). Centres of polyhedral cells and faces are no polynomials: bounds of the
/// measures and their derivatives on intervals of s, halved until they prove the sign or the interval is 1e-12 of s. All
/// amplitudes are safe: never late. The points X + s (Y - X) are meant without rounding.
///
/// Fast where the motion bends cells little: how much each cell bears is computed once from its shape at rest, and a bound of
/// its deformation says of most cells that they are not inverted (quality::MotionCertificate). The other ones, the suspects, are
/// looked at as said above, and so are those that might have the least determinant. The answers are the same.
///
/// Immutable; any thread may call. The cells must outlive it.
/// Source: thesis 7.4 (inversions of elements under deformation).
class InversionCheck {
 public:
  /// rest: n x 3. Throws Error(invalid_argument): no cells, ids out of range, coordinates that are not finite, faces of another
  /// degree or not in a plane z = constant; cancelled, deadline_exceeded.
  InversionCheck(std::span<const Vec3> rest, const CellSet& cells, const RunContext& context = {});
  ~InversionCheck();
  InversionCheck(InversionCheck&&) noexcept;
  InversionCheck& operator=(InversionCheck&&) noexcept;

  std::size_t cell_count() const;
  /// Those left out; the least determinant is over all cells.
  const Inversions& at_rest() const;
  /// How many cells are left-handed.
  std::size_t left_handed() const;

  /// points: n x 3. Parallel; the results do not depend on the number of threads. All throw Error(invalid_argument) for another
  /// number of points, coordinates that are not finite and, in the plane, points off it; cancelled, deadline_exceeded.
  Inversions inverted(std::span<const Vec3> points, const RunContext& context = {}) const;
  /// How many of the cells that have a normalized determinant of at least `margin` at `rest` have less at `points`.
  std::size_t below(double margin, std::span<const Vec3> rest, std::span<const Vec3> points,
                    const RunContext& context = {}) const;
  SafeAmplitude amplitude(std::span<const Vec3> from, std::span<const Vec3> to, const RunContext& context = {}) const;

  /// Upper bound of the memory that a check of these cells holds, and needs for a call. points: of the mesh.
  static std::size_t bytes_for(const CellSet& cells, std::size_t points);
  /// The same while it is made.
  static std::size_t bytes_to_make(const CellSet& cells, std::size_t points);

 private:
  class Impl;
  std::unique_ptr<const Impl> impl_;
};

/// The same for one motion; at_rest are the cells that are inverted at X, left out of the rest of the answer.
struct MotionSafety : SafeAmplitude {
  Inversions at_rest;
};
MotionSafety safe_amplitude(std::span<const Vec3> X, std::span<const Vec3> Y, const CellSet& cells,
                            const RunContext& context = {});

/// Which cells are left-handed, one entry each; empty: none. A block, of which there may be several, is what is connected by
/// sides that the nodes of both cells run around in opposite directions; it is left-handed when most of its cells are (see
/// quality::left_handed_cells()). Throws what the constructor of InversionCheck throws for cells.
std::vector<char> left_handed_cells(std::span<const Vec3> points, const CellSet& cells, const RunContext& context = {});

/// What can be inverted in a mesh, borrowed from it: its cells; of a 2D mesh of triangles and quads its faces; else nothing.
std::optional<CellSet> cell_set(const Mesh& mesh);

/// All points have the same z, up to 1e-9 of the diagonal of their box.
bool in_one_plane(std::span<const Vec3> points);

}  // namespace deform
