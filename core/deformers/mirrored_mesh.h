// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/base/types.h"
#include "core/deformers/handles/symmetry.h"
#include "core/mesh/mesh.h"

namespace deform {

/// A half model with its mirror images in k symmetry planes, as one mesh. An image has a number 0..2^k - 1, whose bit j says
/// whether it is reflected in plane j; image 0 is the half model, and its points come first. Points on a plane are their own
/// images in it. Faces in a plane are left out: they are inside of the whole model. Faces are oriented as those of the half
/// model; cells keep the order of their nodes, which are left-handed in images with an odd number of reflections. There are no
/// groups.
///
/// Immutable; any thread.
class MirroredMesh {
 public:
  /// `symmetry` is that of the mesh. Throws Error(invalid_argument) if the whole model has too many points.
  MirroredMesh(const Mesh& half, const Symmetry& symmetry);

  const std::shared_ptr<const Mesh>& mesh() const { return mesh_; }
  std::size_t images() const { return std::size_t{1} << symmetry_.planes(); }
  /// Points of the half model.
  std::size_t points() const { return on_.size(); }
  /// The point that a point of the half model has in an image.
  PointId image(PointId id, std::size_t image) const { return ids_[reduced(id, image)][id]; }
  /// Whether the image of a point is none of an image with fewer reflections.
  bool is_own(PointId id, std::size_t image) const { return reduced(id, image) == image; }
  /// The images of points that an image does not share with those before it, ascending if `ids` are.
  std::vector<PointId> own_images(std::span<const PointId> ids, std::size_t image) const;

  /// A vector in an image, from or to the half model.
  Vec3 reflected(const Vec3& vector, std::size_t image) const;
  /// A point in an image, from or to the half model.
  Vec3 reflected_point(const Vec3& point, std::size_t image) const;

  /// The first and the last point + 1 of those that image `image` has of its own for the points [begin, end) of the half model.
  std::array<PointId, 2> own_range(std::size_t begin, std::size_t end, std::size_t image) const;

  /// Memory without the mesh, and of the mesh.
  std::size_t bytes() const { return bytes_for(points(), images()); }
  static std::size_t bytes_for(std::size_t points, std::size_t images);
  std::size_t mesh_bytes() const;

 private:
  std::size_t reduced(PointId id, std::size_t image) const { return image & ~std::size_t{on_[id]}; }
  void add_faces(const Mesh& half, Mesh& whole) const;
  void add_cells(const Mesh& half, Mesh& whole) const;

  Symmetry symmetry_;
  std::vector<std::uint8_t> on_;  ///< the planes of each point
  /// Of each image the point for each point of the half model, or the next one that is its own, and the one behind its last.
  std::vector<std::vector<PointId>> ids_;
  std::shared_ptr<const Mesh> mesh_;
};

}  // namespace deform
