// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <string>

#include "core/base/types.h"
#include "core/mesh/mesh.h"

namespace deform {

/// A symmetry plane of a half model.
struct CagePlane {
  Vec3 point{}, normal{};  ///< the normal need not be of unit length; its direction does not matter
};

/// The coordinate axis that a plane is across, if there is one, to 1e-12.
std::optional<std::size_t> axis_of(const CagePlane& plane);
/// "(1, 0, 0.25)"
std::string place_text(const Vec3& place);
/// "y = 0", or "the plane through (1, 0, 2) across (0.6, 0.8, 0)".
std::string plane_text(const CagePlane& plane);
/// "y = 0 and z = 0.25"
std::string planes_text(std::span<const CagePlane> planes);
/// The mirror image of a place. The normal must be of unit length.
Vec3 reflected(const CagePlane& plane, const Vec3& x);

/// Coordinates in which symmetry planes are those through the origin across the first axes, and the mesh of the half model lies
/// where these coordinates are 0 or more: the reflection in plane k changes the sign of coordinate k. Model units. Coordinates
/// along axes of the model keep all their digits. Immutable; any thread.
class MirrorFrame {
 public:
  static constexpr double orthogonality = 1e-6;  ///< largest cosine of the angle between two planes

  /// The side of the mesh is that on which it reaches farther from a plane, that of the normal if it reaches as far on both.
  /// Throws Error(invalid_argument) naming planes[i]: more than three, a point or normal that is not finite, a normal that is
  /// zero, planes that are not orthogonal.
  MirrorFrame(std::span<const CagePlane> planes, const Mesh& mesh);

  std::size_t planes() const { return planes_; }
  Vec3 coordinates(const Vec3& point) const;  ///< of a point of the model
  Vec3 point(const Vec3& coordinates) const;  ///< the other way
  bool is_right_handed() const;

 private:
  std::size_t planes_ = 0;
  std::array<Vec3, 3> axes_{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};  ///< orthonormal
  Vec3 origin_{};
};

/// A triangle mesh where the first `planes` coordinates are 0 or more, with its mirror images, as one mesh: points whose
/// coordinate is exactly 0 are their own images. The points and triangles of the mesh come first, and all images face as they do.
Mesh with_images(const Mesh& mesh, std::size_t planes);

/// The triangles of a mesh that reach to where all of the first `planes` coordinates are over 0, with their points, in order.
Mesh part_beyond(const Mesh& mesh, std::size_t planes);

}  // namespace deform
