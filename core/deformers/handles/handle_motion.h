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

// Handles and designs, common to all methods.

namespace deform {

/// The region of a point: the index of a handle, `fixed_region` or `deformable_region`.
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

/// The frame of a handle, in which the fields 1, x, y, z of its points are measured: unit coordinates relative to a reference
/// point, along three axes (thesis 4.2).
struct HandleFrame {
  Vec3 reference{};                                             ///< unit coordinates
  std::array<Vec3, 3> axes{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};  ///< orthonormal
};

/// The displacement field of an affine motion of a handle as the coefficients of its four fields, 4 x 3, row-major, model
/// units. `motion` maps positions to positions (displacement = motion(x) - x) or, for MotionKind::derivative, positions
/// to displacements.
enum class MotionKind { position, derivative };
void field_coefficients(const Affine& motion, MotionKind kind, const HandleFrame& frame, const UnitBox& box, double* out);

/// The frames of the handles, centred in their bounding boxes. With symmetry planes the axes are those of the planes, and a
/// handle that touches a plane, or whose distance from it is less than its thickness across it, has its reference in that plane:
/// the normal component of a displacement is odd there, so its fields are smooth across the plane if they vanish on it.
std::vector<HandleFrame> handle_frames(const Mesh& mesh, const SelectedRegions& regions, const Symmetry& symmetry,
                                       const UnitBox& box);

/// A design as one affine map or displacements for each handle; owns its data.
struct BoundDesign {
  std::vector<Affine> affine;                   ///< H
  std::vector<std::vector<Vec3>> displacement;  ///< H; empty if the handle has an affine map
  double tolerance = 0;                         ///< tolerance of its solution; 0: that of the setup
  bool is_affine() const;
  bool moves(std::size_t handle) const { return !displacement[handle].empty() || affine[handle] != identity_affine; }
};

/// A view of the handle and fixed points of a system, which are points of the mesh or control points.
struct HeldPoints {
  const Mesh& mesh;
  const Setup& setup;
  const SelectedRegions& regions;
  const Symmetry& symmetry;                             ///< the planes for the points of `mesh`
  const std::vector<RegionIndex>& region_of;            ///< n
  const std::vector<std::uint32_t>& rank_of;            ///< n: position of a handle point among the points of its handle
  const std::vector<std::vector<PointId>>& coincident;  ///< see ConstraintPoints
  double diagonal = 0;

  /// Throws Error(invalid_argument) starting with designs[index], see System::bind().
  BoundDesign bound(const Design& design, std::size_t index) const;
  /// The prescribed position of a point or, for MotionKind::derivative, its derivative. Points are not projected to their
  /// symmetry planes.
  Vec3 prescribed_position(const BoundDesign& design, PointId id, MotionKind kind) const;
  /// The resulting position of a point: points on a symmetry plane stay in it exactly, without rounding errors.
  Vec3 place(const BoundDesign& design, PointId id, MotionKind kind) const;
  /// The resulting displacement of a point, or its derivative. Its error is at the level of its own rounding, also far from the
  /// origin, where the difference of two positions has lost digits.
  Vec3 displacement(const BoundDesign& design, PointId id, MotionKind kind) const;
  /// Throws if coincident points have different prescribed positions.
  void check_coincident(const BoundDesign& design, std::size_t index) const;
  /// The largest displacement of a handle point, model units.
  double largest_displacement(const BoundDesign& design) const;
  /// The largest sum of the magnitudes of the terms that make up the position of a handle point, if no coordinate is larger than
  /// `coordinate`: rounding is a fraction of it. Far from the origin it is much larger than the motion. 0 if nothing moves.
  double largest_terms(const BoundDesign& design, double coordinate) const;
};

/// d(motions)/d(variables) times a direction. Throws Error(invalid_argument) for a direction of the wrong length or not finite.
std::vector<Affine> motion_derivative(const Setup& setup, std::span<const double> variables, std::span<const double> direction);

/// Throws Error(invalid_argument) for a cotangent field of the wrong length or not finite.
void check_cotangent(const Points& cotangent, std::size_t points);

/// Applies the transpose of d(points)/d(variables): from `fields` (4H x 3, row-major, in units of the fields), the contraction of
/// the cotangent field with the handle fields over the following points, and from the cotangent field at the handle points, whose
/// motion is prescribed.
std::vector<double> variable_gradient(const HeldPoints& held, std::span<const double> variables, const Points& cotangent,
                                      std::span<const double> fields, const std::vector<HandleFrame>& frames, const UnitBox& box);

/// A number for each handle, the same for those that the same variables drive, as a handle and its images in symmetry planes. A
/// handle that no variable drives has one of its own.
std::vector<std::size_t> driven_groups(const Setup& setup);

/// Formats a number as "1.2e-05".
std::string scientific(double value);

/// The memory of a system for n points, in bytes: for each point region, rank, id and unit coordinates (plus one tile),
/// coincident groups, symmetry planes.
std::size_t point_bytes(std::size_t n, const Symmetry& symmetry);

}  // namespace deform
