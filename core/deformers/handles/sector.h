// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "core/base/types.h"
#include "core/mesh/mesh.h"
#include "core/mesh/region.h"

namespace deform {

/// One of `count` equal sectors of a wheel: the wheel is deformed as a whole, with the same motion in every sector, turned about
/// the axis.
struct SectorOptions {
  Vec3 origin{};                   ///< a point of the axis
  Vec3 axis{};                     ///< its direction, not zero
  std::uint32_t count = 0;         ///< sectors of the wheel, Sector::least..Sector::most
  std::vector<Region> periodic{};  ///< at most 2: patches whose points must all have a partner
};

/// The sector of a setup on one mesh: points of its two periodic boundaries are partners if one is the image of the other, by one
/// turn of 360 / count degrees about the axis, up to `tolerance` D. Partners are found among the corners of faces, or all points
/// if there are no faces, the nearest first. Points are not snapped: partners get displacements that are images of each other,
/// and points on the axis displacements along it.
///
/// Vectors and places are in the frame of the axis: the axial component first, then two across it, relative to the origin.
/// Immutable; any thread.
class Sector {
 public:
  static constexpr std::size_t least = 2, most = 10000;  ///< limits of the count
  static constexpr double tolerance = 1e-6;              ///< fraction of D: distance of partners and of points from the axis

  Sector() = default;
  /// `places` are those of all points of the mesh, D its diagonal. Throws Error(invalid_argument) naming `field`: count out of
  /// range; a mesh that covers more than one sector; a point of `periodic`, or one surrounded by points that have partners,
  /// that has none, with the distance of the nearest place; and what select() throws.
  Sector(const SectorOptions& options, const Mesh& mesh, std::span<const Vec3> places, double diagonal, const std::string& field);

  /// The number of sectors; 0 if there is none.
  std::size_t count() const { return cosines_.size(); }
  /// A vector or place turned by so many sectors (any number up to the count).
  Vec3 turned(const Vec3& x, std::size_t sectors) const;
  /// The cosine and sine of the angle of so many sectors.
  double cosine(std::size_t sectors) const { return cosines_[sectors]; }
  double sine(std::size_t sectors) const { return sines_[sectors]; }

  /// A point and the one whose place is that of the first turned by one sector.
  struct Pair {
    PointId first, second;
  };
  const std::vector<Pair>& pairs() const { return pairs_; }                   ///< ascending by their second points
  const std::vector<PointId>& axis_points() const { return axis_points_; }    ///< ascending
  bool is_second(PointId id) const { return first_of(id) != id; }             ///< whether it is the image of another point
  PointId first_of(PointId id) const { return count() == 0 ? id : of_[id]; }  ///< the point whose image it is, or itself
  bool on_axis(PointId id) const;                                             ///< whether a point lies on the axis
  bool on_axis(const Vec3& place) const;                                      ///< the same of any place

  /// The displacement of a point, from that of the point whose image it is where it is one: turned, and on the axis along it.
  Vec3 from_first(PointId id, const Vec3& of_first) const;
  /// The transpose: a vector at a point as one at the point whose image it is. Without a sector both change nothing.
  Vec3 at_first(PointId id, const Vec3& vector) const;

  /// How many partners and points on the axis there are, one sentence. Without any partner a second one asks whether that is
  /// meant, and names the count for which points are images of others, if up to 2000 of the mesh show one.
  std::string note() const;
  std::size_t bytes() const;

 private:
  void find_pairs(const Mesh& mesh, std::span<const Vec3> places, const std::string& field);
  void find_likely(const Mesh& mesh, std::span<const Vec3> places);
  void check_chains(const Mesh& mesh, const std::string& field) const;
  void check_holes(const Mesh& mesh, std::span<const Vec3> places, const std::string& field) const;
  void check_patches(const SectorOptions& options, const Mesh& mesh, std::span<const Vec3> places,
                     const std::string& field) const;
  std::string without_partner(PointId id, std::span<const Vec3> places) const;

  std::vector<double> cosines_, sines_;  ///< of each number of sectors
  double reach_ = 0;                     ///< tolerance D
  std::vector<PointId> of_;              ///< n: first_of()
  std::vector<Pair> pairs_;
  std::vector<PointId> axis_points_;
  std::size_t likely_ = 0, likely_pairs_ = 0;  ///< without partners: another count that has some, or 0
};

}  // namespace deform
