// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/mesh/mesh.h"
#include "core/quality/extreme.h"

namespace deform {

/// Finds the faces of a surface that are folded over, that is whose normals turned by more than 90 degrees relative to the rigid
/// motion of their neighbourhood. Prepared once for a rest state, then used for many deformed ones.
///
/// Two faces with a common edge form a hinge, whose state is the angle about the edge by which the normal turns from one to the
/// other. The change delta in (-180, 180] degrees of that angle since the rest state does not depend on a common motion of the
/// two faces, on sharp edges, or on inconsistent orientations at rest. A surface that is folded onto itself, as by motions along
/// it, has edges with delta = 180 at any resolution, and the faces between two rows of such edges are upside down; a smooth bend
/// has small deltas. Therefore:
///  1. Faces are assigned to two sides: two neighbours to the same side if |delta| < 120, to opposite sides otherwise, with a
///     weight that grows towards 0 and 180 and with the length of the edge at rest; if the assignments are contradictory, many
///     edges outvote few (two_sides.h). Sharp edges count less (factor 0.05 from 90 degrees at rest on): if both sheets at a
///     corner of a box are folded over along their edge, delta is 180 there too, although both are upside down. A lid that is
///     rotated about its hinge by up to 120 degrees stays on its side. Faces are upright, and never flipped, that are where they
///     were: none of their corners moved by more than 1e-6 of the largest displacement of a point (or of the diagonal of the
///     bounding box, if that is smaller), which is what solvers leave of fixed points. In a connected component without any the
///     side with the larger area at rest is upright; of two equal ones, the one that turned less.
///  2. A face is flipped if the mean of cos(delta) over its neighbours, with opposite sign for those that are not upright, is
///     negative, that is if it faces away from the orientation that they imply. This also finds single faces that turned by more
///     than 90 degrees. With one neighbour the sides decide; a face without neighbours is not flipped.
///  3. A crease is rarely as sharp as an edge: if a motion along the surface also has a component across it, and the faces are
///     small enough, the normal turns over several rows of faces. Such a crease differs from a bend in that its faces are
///     crushed, that is compressed in one direction to less than half. So in steps 1 and 2 crushed faces (including collapsed
///     ones) have the normals that their neighbours extrapolate into them, across up to 32 rows; where the extrapolations from
///     both sides of a crease meet, delta relates the two sides. A crushed face is flipped if its own normal is opposite to the
///     extrapolated one. A crease of which less than 120 degrees are crushed counts as a bend.
///  4. A collapsed face, which has no area left up to rounding, has no orientation and counts as flipped, with a cosine of 0.
/// Faces without area at rest are ignored. Faces are neighbours if they share two points by id: parts that only touch are
/// checked separately. A component that is reflected or turned inside out as a whole is not detected.
///
/// Immutable; any thread may call. Time: one pass over the faces if the displacements of the corners of each face differ by less
/// than about a fifth of its size. Otherwise edges are examined only where normals turned by more than 30 degrees, and all of
/// them only if some delta exceeds 90 degrees or a face is crushed.
class FlipCheck {
 public:
  /// `rest` (n x 3) holds the rest points of the mesh; both must outlive this object. Throws Error(invalid_argument) for a wrong
  /// number of points, cancelled, deadline_exceeded.
  FlipCheck(const Mesh& mesh, std::span<const Vec3> rest, const RunContext& context = {});
  ~FlipCheck();

  /// The flipped faces for deformed points (n x 3), with the mean cosine of step 2, worst first, equal ones by id. Parallel; the
  /// result depends neither on the number of threads nor on the order of the faces. Throws like the constructor.
  std::vector<Extreme> flipped(std::span<const Vec3> points, const RunContext& context = {}) const;

  std::size_t face_count() const;  ///< f
  std::size_t bytes() const;       ///< memory of this object

  /// Upper bounds in bytes: of the memory of this object with that of its construction, and of the memory of a call.
  static std::size_t bytes_for(const Mesh& mesh);
  std::size_t call_bytes() const;  ///< see bytes_for()

 private:
  class Impl;
  std::unique_ptr<const Impl> impl_;
};

/// The flipped faces of a single deformation, where `mesh` has the deformed points.
std::vector<Extreme> flipped_faces(const Mesh& mesh, std::span<const Vec3> rest, const RunContext& context = {});

}  // namespace deform
