// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "core/base/types.h"
#include "core/deformers/setup.h"
#include "core/deformers/system.h"
#include "core/mesh/mesh.h"

// What every method does with handles and designs.

namespace deform {

/// Region number of a point: a handle's index, `fixed_region` or `deformable_region`.
using RegionIndex = std::uint32_t;
inline constexpr RegionIndex fixed_region = 0xfffffffeu;
inline constexpr RegionIndex deformable_region = 0xffffffffu;

/// Coordinates of the unit box: x = origin + scale * unit.
struct UnitBox {
  Vec3 origin{};
  double scale = 1;
  Vec3 to_unit(const Vec3& x) const {
    return {(x[0] - origin[0]) / scale, (x[1] - origin[1]) / scale, (x[2] - origin[2]) / scale};
  }
  Vec3 to_model(const Vec3& y) const { return {origin[0] + scale * y[0], origin[1] + scale * y[1], origin[2] + scale * y[2]}; }
};

std::vector<Vec3> unit_places(const Mesh& mesh, const UnitBox& box, std::span<const PointId> ids);

/// What moves with a handle: the fields 1, x, y, z of its points, in unit coordinates relative to a point of reference and along
/// three axes (thesis 4.2).
struct HandleFrame {
  Vec3 reference{};                                             ///< unit coordinates
  std::array<Vec3, 3> axes{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};  ///< orthonormal
};

/// Displacement field of an affine motion on a handle as the coefficients of its four fields, 4 x 3 row by row, model units.
/// `motion` maps positions to positions (displacement = motion(x) - x) or, with derivative, positions to displacements.
enum class MotionKind { position, derivative };
void field_coefficients(const Affine& motion, MotionKind kind, const HandleFrame& frame, const UnitBox& box, double* out);

/// Frames in the middle of the boxes of the handles. With symmetry planes the axes are those of the planes, and a handle that
/// reaches a plane, or comes closer to it than it is thick across it, has its reference in that plane: the component of a
/// displacement along the normal of a plane is odd there, so its fields are smooth across the plane if they vanish on it.
std::vector<HandleFrame> handle_frames(const Mesh& mesh, const SelectedRegions& regions, const UnitBox& box);

/// What a design comes down to: per handle an affine map or displacements, borrowed from nobody.
struct BoundDesign {
  std::vector<Affine> affine;                   ///< H
  std::vector<std::vector<Vec3>> displacement;  ///< H, empty where the affine map holds
  double tolerance = 0;                         ///< of its solution; 0: that of the setup
  bool is_affine() const;
  bool moves(std::size_t handle) const { return !displacement[handle].empty() || affine[handle] != identity_affine; }
};

/// The handle and fixed points of a system, borrowed from it: points of the mesh, or control points.
struct HeldPoints {
  const Mesh& mesh;
  const Setup& setup;
  const SelectedRegions& regions;
  const std::vector<RegionIndex>& region_of;            ///< n
  const std::vector<std::uint32_t>& rank_of;            ///< n: position of a handle point among the points of its handle
  const std::vector<std::vector<PointId>>& coincident;  ///< see ConstraintPoints
  double diagonal = 0;

  /// Throws Error(invalid_argument) starting with designs[index], see System::bind().
  BoundDesign bound(const Design& design, std::size_t index) const;
  /// Where a point is sent; with MotionKind::derivative the derivative of that. Points on symmetry planes are not slid.
  Vec3 prescribed_position(const BoundDesign& design, PointId id, MotionKind kind) const;
  /// Where it goes: points on a symmetry plane stay in it to the last digit, whatever was rounded on the way.
  Vec3 place(const BoundDesign& design, PointId id, MotionKind kind) const;
  /// Refuses coincident points that are sent to different places.
  void check_coincident(const BoundDesign& design, std::size_t index) const;
  /// Largest displacement of a handle point, model units.
  double largest_displacement(const BoundDesign& design) const;
};

/// d(motions)/d(variables) times a direction. Throws Error(invalid_argument) for a direction of the wrong length or not finite.
std::vector<Affine> motion_derivative(const Setup& setup, std::span<const double> variables, std::span<const double> direction);

/// Throws Error(invalid_argument) for a cotangent field of the wrong length or not finite.
void check_cotangent(const Points& cotangent, std::size_t points);

/// d/d(variables)^T from what the cotangent field sums up to: `fields` (4H x 3, row by row) over the points that follow the
/// handles' fields, in units of the fields; and over the handle points themselves, which go where the motions say.
std::vector<double> variable_gradient(const HeldPoints& held, std::span<const double> variables, const Points& cotangent,
                                      std::span<const double> fields, const std::vector<HandleFrame>& frames, const UnitBox& box);

/// "1.2e-05"
std::string scientific(double value);

/// What a system keeps of n points. Per point: region, rank, id and unit coordinates (a tile more), group lists; planes.
std::size_t point_bytes(std::size_t n, const Symmetry& symmetry);

}  // namespace deform
