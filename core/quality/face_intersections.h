// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/mesh/mesh.h"
#include "core/mesh/triangle_tree.h"

namespace deform {

/// A face that intersects another one.
struct IntersectingFace {
  FaceId face = 0;   ///< the face
  FaceId other = 0;  ///< one of those that it intersects
};

/// Finds the faces of a surface that intersect others: where parts, or parts of a part, run into each other. Faces intersect if
/// they have more in common than the corners and edges that they share, touching included; exactly (core/mesh/triangle_pairs.h).
/// Points at the same place at rest are one as long as they stay together: STL files have corners of their own for each facet.
/// A polygon is a fan of triangles around its fan_apex() at rest (core/mesh/polygon_fan.h). Triangles
/// without area are passed over: degenerate and flipped faces are other checks. Prepared once for a rest state, then used for
/// many deformed ones. Immutable; any thread may call. Time: that of a search in a tree of boxes for each face.
class IntersectionCheck {
 public:
  /// `rest` (n x 3) holds the rest points of the mesh; neither is kept. Throws Error(invalid_argument) for a wrong number of
  /// points, cancelled, deadline_exceeded.
  IntersectionCheck(const Mesh& mesh, std::span<const Vec3> rest, const RunContext& context = {});

  /// The faces that intersect others at rest, ascending.
  const std::vector<IntersectingFace>& at_rest() const { return at_rest_; }

  /// The faces that intersect others at deformed points (n x 3), ascending. The result does not depend on the number of threads.
  /// Throws like the constructor.
  std::vector<IntersectingFace> at(std::span<const Vec3> points, const RunContext& context = {}) const;

  /// Those of at() that ran into each other: neither a face nor a neighbour of it intersected the other one or a neighbour of
  /// that at rest. Where parts run through each other at rest, as in many models of cars, nearby faces do so in every design.
  /// `other` is a face that was run into.
  std::vector<IntersectingFace> appeared(std::span<const Vec3> points, const RunContext& context = {}) const;

  std::size_t face_count() const { return faces_; }  ///< f

  std::size_t bytes() const;  ///< memory of this object

  /// Upper bounds in bytes: of the memory of this object with that of its construction, and of the memory of a call.
  static std::size_t bytes_for(const Mesh& mesh);
  std::size_t call_bytes() const;  ///< see bytes_for()

 private:
  using Triangle = std::array<PointId, 3>;
  /// Lists of triangles, one after the other.
  struct Lists {
    std::vector<std::uint64_t> starts;
    std::vector<std::uint32_t> items;

    std::span<const std::uint32_t> of(std::size_t list) const {
      return std::span(items).subspan(starts[list], starts[list + 1] - starts[list]);
    }
  };

  void add_fan(std::span<const PointId> corners, std::span<const Vec3> rest, FaceId face);
  TriangleTree moved(std::span<const Vec3> points, const RunContext& context) const;
  /// use(triangle, other) for the triangles that intersect each other, for each triangle until it returns false. Concurrent calls
  /// are for triangles of different faces.
  void for_each_pair(const TriangleTree& tree, std::span<const Vec3> points, const RunContext& context,
                     const std::function<bool(std::uint32_t triangle, std::uint32_t other)>& use) const;
  std::vector<IntersectingFace> faces_found(const TriangleTree& tree, std::span<const Vec3> points, const RunContext& context,
                                            const std::function<bool(std::uint32_t, std::uint32_t)>& counts) const;
  void remember_rest(std::span<const Vec3> rest, const RunContext& context);
  bool intersected_nearby(std::uint32_t triangle, std::uint32_t other) const;

  std::size_t points_ = 0, faces_ = 0;
  std::vector<Triangle> triangles_;
  std::vector<std::uint32_t> starts_;  ///< of the triangles of each face
  std::vector<FaceId> face_of_;        ///< of each triangle
  std::vector<PointId> same_;          ///< of each point the least id at its place at rest
  TriangleTree tree_;                  ///< of the rest points
  std::vector<IntersectingFace> at_rest_;
  // What intersects at rest; empty where nothing does.
  Lists partners_;  ///< of each triangle, at most most_partners and one more to say that there are others
  Lists uses_;      ///< the triangles around each place
};

/// The faces of a mesh that intersect others, where its points count as its rest points.
std::vector<IntersectingFace> intersecting_faces(const Mesh& mesh, const RunContext& context = {});

}  // namespace deform
