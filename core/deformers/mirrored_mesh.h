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
/// Or a sector with its images 0..N - 1, the number of turns. Of two partners the image of the first is that of the second in the
/// image before, and so the second's, but for the sector itself. Faces between points of one periodic boundary are left out.
///
/// Immutable; any thread.
class MirroredMesh {
 public:
  /// `symmetry` is that of the mesh. Throws Error(invalid_argument) if the whole model has too many points.
  MirroredMesh(const Mesh& half, const Symmetry& symmetry);

  const std::shared_ptr<const Mesh>& mesh() const { return mesh_; }
  const Symmetry& symmetry() const { return symmetry_; }
  std::size_t images() const { return symmetry_.images(); }
  /// Points of the half model.
  std::size_t points() const { return on_.size(); }
  /// The point that a point of the half model has in an image.
  PointId image(PointId id, std::size_t image) const {
    const Place own = owner(id, image);
    return ids_[own.image][own.id];
  }
  /// Whether the image of a point is none of another image, or point, that owns it.
  bool is_own(PointId id, std::size_t image) const {
    const Place own = owner(id, image);
    return own.id == id && own.image == image;
  }
  /// The images of points that an image does not share with those before it, ascending if `ids` are.
  std::vector<PointId> own_images(std::span<const PointId> ids, std::size_t image) const;

  /// A vector of the model in an image. Reflections are their own inverses.
  Vec3 reflected(const Vec3& vector, std::size_t image) const;
  /// A point of the model in an image.
  Vec3 reflected_point(const Vec3& point, std::size_t image) const;
  bool turns() const { return symmetry_.is_sector(); }  ///< whether images are turned and not reflected
  /// The image that takes an image back.
  std::size_t inverse(std::size_t image) const { return symmetry_.is_sector() ? (images() - image) % images() : image; }

  /// The first and the last point + 1 of those that image `image` has of its own for the points [begin, end) of the half model.
  std::array<PointId, 2> own_range(std::size_t begin, std::size_t end, std::size_t image) const;

  /// Memory without the mesh, and of the mesh.
  std::size_t bytes() const { return bytes_for(points(), images()); }
  static std::size_t bytes_for(std::size_t points, std::size_t images);
  std::size_t mesh_bytes() const;

 private:
  struct Place {
    PointId id;
    std::size_t image;
  };
  Place owner(PointId id, std::size_t image) const;
  void add_faces(const Mesh& half, Mesh& whole) const;
  void add_cells(const Mesh& half, Mesh& whole) const;

  Symmetry symmetry_;
  std::vector<std::uint8_t> on_;  ///< the planes of each point, or the bits below
  enum OfSector : std::uint8_t { first_boundary = 1, second_boundary = 2, axis = 4 };
  std::vector<PointId> partner_;  ///< of each point of a periodic boundary; empty without a sector
  /// For each image the point for each point of the half model, or the next one that is its own, and the one behind its last.
  std::vector<std::vector<PointId>> ids_;
  std::shared_ptr<const Mesh> mesh_;
};

}  // namespace deform
