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

/// The corners of any face of a mesh; borrows it. Nothing is stored where all faces have equally many.
class FaceCorners {
 public:
  explicit FaceCorners(const Mesh& mesh);
  std::size_t size() const { return mesh_.face_sizes.size(); }
  bool triangles() const { return equal_ == 3; }
  const PointId* triangle(std::size_t face) const { return mesh_.face_points.data() + 3 * face; }  ///< where all are triangles
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

/// Unit normal of a face; zero where its area is nothing up to rounding, `rounding` being the error of coordinates.
Vec3 unit_normal(std::span<const Vec3> points, std::span<const PointId> corners, double rounding);

/// Whether a face was squeezed together in one direction: to less than half of its size at rest, and of how much it was
/// stretched across. `normal`: at rest.
bool is_crushed(std::span<const Vec3> rest, std::span<const Vec3> points, std::span<const PointId> corners, const Vec3& normal);

/// Cosine and sine of the angle by which the normal turns from a face to its neighbour, about their edge; both zero where a
/// normal or the edge is.
struct Turn {
  double cosine = 0, sine = 0;
  bool known() const { return cosine != 0 || sine != 0; }
};
Turn turn_between(const Vec3& normal, const Vec3& next, const Vec3& edge);

/// The normal on the other side of an edge at which it makes this turn.
Vec3 turned_normal(const Vec3& normal, const Turn& turn, const Vec3& edge);

/// Two faces with a common edge, and how the normal turns from the first to the second at rest.
struct FacePair {
  FaceId first = 0, second = 0;
  PointId from = 0, to = 0;
  float cosine = 0, sine = 0;
};

/// All pairs of faces with a common edge, by the points of their edges; normals: of the faces at rest, those without are left
/// out. Where three or four faces meet, each makes a pair with each; more do not meet at edges of surfaces: they are left out.
/// What the pairs are and how they are ordered does not depend on the order of the faces.
std::vector<FacePair> face_pairs(const Mesh& mesh, const FaceCorners& corners, std::span<const Vec3> rest,
                                 std::span<const Vec3> normals, const RunContext& context);

/// Bytes while face_pairs() works, with its result, for so many corners of faces.
std::size_t face_pairs_bytes(std::size_t points, std::size_t corners);

}  // namespace deform::quality
