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
/// has small deltas. Therefore: 1. Faces are put on two sides: on the same one where |delta| < 120, on opposite ones beyond, the
/// surer the closer delta is to
///     0 or 180, weighted with the length of the edge at rest; where that contradicts itself, many edges outvote few
///     (two_sides.h). Sharp edges count less (times 0.05 from 90 degrees at rest on): where both sheets of a box's corner are
///     folded over along their edge, delta is 180 there too, although both lie the wrong way round. A lid that is turned about
///     its hinge by up to 120 degrees stays on its side. The side with more area at rest is upright, connected part by connected
///     part; of two equal ones that which turned less.
///  2. A face is flipped where the mean of cos(delta) over its neighbours, with opposite sign for those that are not upright, is
///     negative: it looks away from where they would have it. This also finds single faces beyond 90 degrees. With one neighbour
///     the sides decide; without any it is not flipped.
///  3. A crease is seldom as sharp as an edge: where a motion along the surface also has a part across it, and the faces are
///     small enough, the normal turns over several rows of faces. What tells such a crease from a bend is that its faces are
///     crushed: squeezed in one direction to less than half. So crushed faces (collapsed ones among them) take part in 1 and 2
///     with the normals that their neighbours carry on into them, across up to 32 rows; where those from the two banks of a
///     crease meet, delta tells how the banks lie to each other. A crushed face is flipped where its own normal looks away from
///     the carried one; one that collapsed has none and is not counted. A crease of which less than 120 degrees are crushed is a
///     bend.
/// Faces without area at rest take no part. Faces are neighbours when they share two points by number: parts that only touch are
/// judged one by one. A part that is reflected or turned inside out as a whole has no surroundings to tell.
///
/// Immutable; any thread may call. Time: a pass over the faces where the displacements of their corners differ by less than about
/// a fifth of their size; others are looked at closer, edges only where normals turned by more than 30 degrees, and all of them
/// only where a delta exceeds 90 or a face is crushed.
class FlipCheck {
 public:
  /// `rest` (n x 3) holds the rest points of the mesh; both must outlive this object. Throws Error(invalid_argument) for a wrong
  /// number of points, cancelled, deadline_exceeded.
  FlipCheck(const Mesh& mesh, std::span<const Vec3> rest, const RunContext& context = {});
  ~FlipCheck();

  /// The flipped faces for deformed points (n x 3), with the mean cosine of step 2, worst first, equal ones by id. Parallel; the
  /// result depends neither on the number of threads nor on the order of the faces. Throws like the constructor.
  std::vector<Extreme> flipped(std::span<const Vec3> points, const RunContext& context = {}) const;

  std::size_t face_count() const;
  std::size_t bytes() const;  ///< memory of this object

  /// Upper bounds in bytes: of the memory of this object with that of its construction, and of the memory of a call.
  static std::size_t bytes_for(const Mesh& mesh);
  std::size_t call_bytes() const;

 private:
  class Impl;
  std::unique_ptr<const Impl> impl_;
};

/// The flipped faces of a single deformation, where `mesh` has the deformed points.
std::vector<Extreme> flipped_faces(const Mesh& mesh, std::span<const Vec3> rest, const RunContext& context = {});

}  // namespace deform
