// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "core/base/types.h"
#include "core/deformers/handles/sector.h"
#include "core/mesh/mesh.h"
#include "core/mesh/region.h"

namespace deform {

/// A symmetry plane of a half model, which is deformed as a whole with its mirror image, or the sector of a wheel.
struct SymmetryPlane {
  struct Plane {
    Vec3 point{}, normal{};  ///< the normal need not be of unit length; its direction does not matter
  };
  /// Either a given plane, or a region whose points lie in one plane (a patch, or a line in a planar mesh). The latter is fitted
  /// by least squares, and made perpendicular to a coordinate axis if that fits the points as well (up to twice the distance).
  std::variant<Plane, Region, SectorOptions> kind;
};

/// The symmetry planes or the sector of a setup on one mesh. Points within `Symmetry::tolerance` D of a given plane lie on it,
/// and so do the points of the region of a fitted plane and all that are no farther away. Points are not snapped: they keep their
/// distance from the plane. Immutable; any thread.
class Symmetry {
 public:
  static constexpr double tolerance = 1e-9;  ///< fraction of D: distance of points on a plane, and deviation from orthogonality
  static constexpr double flatness = 1e-6;   ///< fraction of D: distance of the points of a region from their plane

  Symmetry() = default;
  /// Throws Error(invalid_argument) naming symmetry[i]: a sector besides planes or other sectors, the errors of Sector, more than
  /// three planes or planes that are not orthogonal (within `tolerance`, or `flatness` if one of them is fitted), zero or
  /// non-finite normal, a region whose points do not define a plane or do not lie in one (with the largest distance and its
  /// point), a mesh on both sides of a plane (with the number of points on the side with fewer, the first and its distance), and
  /// what select() throws.
  Symmetry(std::span<const SymmetryPlane> planes, const Mesh& mesh);
  /// The same planes for other points, such as control points: on(id) and held() are those of these. The partners of a sector
  /// remain those of the mesh.
  Symmetry for_points(std::span<const Vec3> points) const;

  std::size_t planes() const { return planes_; }
  bool empty() const { return planes_ == 0 && !is_sector(); }
  /// With a sector there are no planes, and the frame is that of its axis.
  bool is_sector() const { return sector_.count() > 0; }
  const Sector& sector() const { return sector_; }
  /// Copies of the model in the whole one, itself included.
  std::size_t images() const { return is_sector() ? sector_.count() : std::size_t{1} << planes_; }
  const Vec3& normal(std::size_t plane) const { return axes_[plane]; }  ///< unit, to the side of the mesh
  std::size_t held(std::size_t plane) const { return held_[plane]; }    ///< number of points on a plane
  double reach(std::size_t plane) const { return reach_[plane]; }  ///< largest distance of these points, at least `tolerance` D

  /// Bit k: the point lies on plane k. 0 without planes.
  unsigned on(PointId id) const { return on_.empty() ? 0u : on_[id]; }
  /// The same for any place: it lies within reach() of plane k. For points of the mesh that is on().
  unsigned on(const Vec3& place) const;

  /// Components of a vector in the frame of the planes: first along their normals, in order, then tangential ones; and back. With
  /// a sector the first one is along the axis.
  Vec3 to_frame(const Vec3& vector) const;
  Vec3 from_frame(const Vec3& components) const;
  /// Components in the frame without those along the normals of these planes (mask).
  static Vec3 within(Vec3 components, unsigned mask);
  /// A displacement in the frame, of a place anywhere, without what would lead out of planes on which it lies or off the axis.
  Vec3 admissible(Vec3 components, const Vec3& place) const;
  /// The position in the frame of the planes, model units. The reflection in plane k changes the sign of coordinate k.
  Vec3 coordinates(const Vec3& point) const;
  /// The mirror image of a point in a plane, in model coordinates.
  Vec3 reflected(const Vec3& point, std::size_t plane) const;
  /// Images have numbers: masks of planes in which a point is reflected, one after the other, or numbers of sectors by which it
  /// is turned. The image of a point, in model coordinates, and of a displacement in the frame.
  Vec3 image(Vec3 point, unsigned image) const;
  Vec3 components_in(Vec3 components, unsigned image) const;
  /// The image that takes an image back, and that of an image.
  unsigned inverse(unsigned image) const;
  unsigned composed(unsigned first, unsigned second) const;
  /// A vector or a point turned by so many sectors, in model coordinates.
  Vec3 turned(const Vec3& vector, std::size_t sectors) const;
  Vec3 turned_point(const Vec3& point, std::size_t sectors) const;

  /// `to` with the normal components of x for the planes on which x lies (mask). For axis-aligned planes these coordinates equal
  /// those of x exactly.
  Vec3 slid(const Vec3& x, const Vec3& to, unsigned mask) const;

 private:
  struct Found;
  void find(const SymmetryPlane& plane, std::size_t index, const Mesh& mesh, const Box& box, Found& found);
  void make_orthonormal(std::span<const Found> found);
  void mark(std::size_t plane, const Found& found, const Mesh& mesh, double diagonal);
  void set_sector(const SectorOptions& options, const Mesh& mesh, double diagonal, const std::string& what);

  std::size_t planes_ = 0;
  std::array<Vec3, 3> axes_{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};  ///< orthonormal
  std::array<Vec3, 3> anchors_{};                                ///< origins of coordinate k
  std::array<std::size_t, 3> held_{};
  std::array<double, 3> reach_{};
  std::vector<std::uint8_t> on_;  ///< n, or empty
  Sector sector_;
};

/// The bounding box of a mesh and its images. Throws nothing.
Box whole_box(const Mesh& mesh, const Symmetry& symmetry);

}  // namespace deform
