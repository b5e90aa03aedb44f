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

/// Finds the faces of a surface that are folded over: whose normals turned by more than 90 degrees against the rigid motion of
/// their surroundings. Prepared once for a rest state, asked for many deformed ones.
///
/// Two faces with a common edge are like a hinge: the angle about the edge by which the normal turns from one to the other says
/// all about how they lie to each other. By how much that angle changed since the rest state, delta in (-180, 180] degrees, does
/// not depend on how the two moved together, on sharp edges or on windings that disagree at rest. A surface that is folded over
/// in itself, as motions along it do, has edges with delta = 180 at any resolution, and what is between two such rows of edges
/// lies the wrong way round; a smooth bend has small deltas. So
///  1. Faces are put on two sides: on the same one where |delta| < 120, on opposite ones beyond, the surer the closer delta is to
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
  /// The mesh says what the faces are, `rest` (n x 3) where its points were; both are borrowed. Throws Error(invalid_argument)
  /// for another number of points, cancelled, deadline_exceeded.
  FlipCheck(const Mesh& mesh, std::span<const Vec3> rest, const RunContext& context = {});
  ~FlipCheck();

  /// The faces that are flipped when the points are `points` (n x 3), with the cosine of step 2, worst first; equal ones by id.
  /// Parallel; the same for any number of threads, and for any order of the faces. Throws like the constructor.
  std::vector<Extreme> flipped(std::span<const Vec3> points, const RunContext& context = {}) const;

  std::size_t face_count() const;
  std::size_t bytes() const;  ///< that it holds

  /// Upper bounds: of what is held, and needed besides while it is made; and of what a call needs.
  static std::size_t bytes_for(const Mesh& mesh);
  std::size_t call_bytes() const;

 private:
  class Impl;
  std::unique_ptr<const Impl> impl_;
};

/// The same for one deformation: the mesh has the deformed points.
std::vector<Extreme> flipped_faces(const Mesh& mesh, std::span<const Vec3> rest, const RunContext& context = {});

}  // namespace deform
