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
///  - faces in the plane: the least sine of a corner, positive in the orientation that most of the area has at rest.
///    Inverted: the signed area of a corner is not positive.
/// "Not positive" is meant up to rounding: determinants at most 1e-14 of the product of their lengths (polyhedra: 1e-13 of areas
/// times the size of the cell) count as collapsed, so a cell at the brink is rather called inverted.
struct Inversions {
  std::size_t count = 0;
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

  /// points: n x 3. Parallel; the results do not depend on the number of threads. Both throw Error(invalid_argument) for another
  /// number of points, coordinates that are not finite and, in the plane, points off it; cancelled, deadline_exceeded.
  Inversions inverted(std::span<const Vec3> points, const RunContext& context = {}) const;
  SafeAmplitude amplitude(std::span<const Vec3> from, std::span<const Vec3> to, const RunContext& context = {}) const;

  /// Upper bound of the memory that a check of these cells holds, and needs for a call.
  static std::size_t bytes_for(const CellSet& cells);

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

}  // namespace deform
