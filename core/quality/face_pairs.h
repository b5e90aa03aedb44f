// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/mesh/mesh.h"

namespace deform::quality {

/// Access to the corners of the faces of a mesh, which must outlive it. Stores nothing if all faces have the same number
/// of corners.
class FaceCorners {
 public:
  explicit FaceCorners(const Mesh& mesh);
  std::size_t size() const { return mesh_.face_sizes.size(); }
  bool triangles() const { return equal_ == 3; }
  const PointId* triangle(std::size_t face) const { return mesh_.face_points.data() + 3 * face; }  ///< requires triangles()
  std::span<const PointId> operator[](std::size_t face) const {
    const std::size_t begin = equal_ > 0 ? equal_ * face : offsets_[face];
    return std::span(mesh_.face_points).subspan(begin, mesh_.face_sizes[face]);
  }
  std::size_t bytes() const { return offsets_.size() * sizeof(offsets_[0]); }

 private:
  const Mesh& mesh_;
  std::size_t equal_ = 0;
  std::vector<std::uint64_t> offsets_;
};

/// The unit normal of a face; zero if its area vanishes up to rounding. `rounding` is the error of the coordinates.
Vec3 unit_normal(std::span<const Vec3> points, std::span<const PointId> corners, double rounding);

/// Whether a face was compressed in one direction to less than half of its rest size, and to less than half of its stretch in the
/// other direction. `normal` is its normal at rest.
bool is_crushed(std::span<const Vec3> rest, std::span<const Vec3> points, std::span<const PointId> corners, const Vec3& normal);

/// Cosine and sine of the angle by which the normal turns about the edge from a face to its neighbour; both zero if a normal or
/// the edge is zero.
struct Turn {
  double cosine = 0, sine = 0;
  bool known() const { return cosine != 0 || sine != 0; }
};
Turn turn_between(const Vec3& normal, const Vec3& next, const Vec3& edge);

/// The normal of the neighbour across an edge with this turn.
Vec3 turned_normal(const Vec3& normal, const Turn& turn, const Vec3& edge);

/// Two faces with a common edge, and the turn of the normal from the first to the second at rest.
struct FacePair {
  FaceId first = 0, second = 0;
  PointId from = 0, to = 0;
  float cosine = 0, sine = 0;
};

/// All pairs of faces with a common edge, ordered by the points of their edges. `normals` are those of the faces at rest; faces
/// with a zero normal are left out. If three or four faces share an edge, every two of them form a pair; edges with more faces
/// are left out. The pairs and their order do not depend on the order of the faces.
std::vector<FacePair> face_pairs(const Mesh& mesh, const FaceCorners& corners, std::span<const Vec3> rest,
                                 std::span<const Vec3> normals, const RunContext& context);

/// The peak memory of face_pairs() in bytes, including its result, for these numbers of points and of face corners.
std::size_t face_pairs_bytes(std::size_t points, std::size_t corners);

}  // namespace deform::quality
