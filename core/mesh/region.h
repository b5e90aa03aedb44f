// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/mesh/mesh.h"

namespace deform {

/// Describes a set of points of a mesh, or of control points of a deformation, so that it can be selected on any mesh. A region
/// is a tree, in which combinators have child regions; only Union, Intersection, Difference and Complement apply to control
/// points. Lengths are in model units. All selections are closed sets: points exactly on the surface of a box, sphere, ... belong
/// to it.
struct Region {
  struct All {};
  /// The points of a group.
  struct GroupName {
    std::string name;  ///< selects the points of the group and of its faces
  };
  /// Axis-aligned box.
  struct InBox {
    Vec3 min{};  ///< least coordinates
    Vec3 max{};  ///< largest coordinates
  };
  /// Solid sphere.
  struct InSphere {
    Vec3 centre{};      ///< centre of the sphere
    double radius = 0;  ///< radius of the sphere
  };
  /// Finite solid cylinder between two axis points.
  struct InCylinder {
    Vec3 start{};       ///< one end of the axis
    Vec3 end{};         ///< the other end of the axis
    double radius = 0;  ///< radius of the cylinder
  };
  /// (x - point) . normal >= 0; the normal need not be of unit length.
  struct InHalfSpace {
    Vec3 point{};   ///< a point on the plane
    Vec3 normal{};  ///< points into the half-space
  };
  /// Points by number.
  struct Ids {
    std::vector<PointId> ids;  ///< numbers of points
  };
  struct OpenBoundary {};  ///< end points of edges that belong to exactly one face
  /// The surface of a volume mesh: points of the faces that belong to exactly one cell, including patches of type "empty". In a
  /// mesh without cells: points of its faces.
  struct Boundary {};
  /// Control points (i, j, k) of a lattice, from the first to the last along each axis, both inclusive; the whole axis if
  /// not set.
  struct LatticeRange {
    /// A range of indices along an axis.
    struct Range {
      std::uint32_t first = 0;  ///< the first index
      std::uint32_t last = 0;   ///< the last index
    };
    std::array<std::optional<Range>, 3> along{};  ///< for each axis
  };
  /// Control points by number.
  struct ControlIds {
    std::vector<std::uint32_t> ids;  ///< numbers of control points
  };
  /// The smooth part of the surface around a place, see smooth_patch(): all corners of its faces. The surface is that of
  /// Boundary.
  struct Patch {
    std::variant<Vec3, PointId>
        seed;           ///< from the face nearest to a place, at most 5 % of D away, or from all faces around a point
    double angle = 30;  ///< degrees between normals that an edge may have, over 0 and up to 180
  };
  /// The points of any of the regions.
  struct Union {
    std::vector<Region> of;  ///< the regions
  };
  /// The points that all regions have.
  struct Intersection {
    std::vector<Region> of;  ///< the regions
  };
  /// The first region without all the others.
  struct Difference {
    std::vector<Region> of;  ///< the regions, that from which the others are taken first
  };
  /// All points but those of the region.
  struct Complement {
    std::vector<Region> of;  ///< exactly one
  };
  /// The region and `rings` rings of mesh neighbours (points that share a face) around it.
  struct Grow {
    std::vector<Region> of;  ///< exactly one
    int rings = 1;           ///< 0..1000
  };

  std::variant<All, GroupName, InBox, InSphere, InCylinder, InHalfSpace, Ids, OpenBoundary, Boundary, LatticeRange, ControlIds,
               Patch, Union, Intersection, Difference, Complement, Grow>
      kind;  ///< the region
};

/// The selected point ids, sorted and unique. May be empty; callers that need points check this. `what` names the region in
/// errors ("handle \"roof\""). Throws Error(invalid_argument): unknown group (with the nearest names), id out of range, min >
/// max, negative or non-finite lengths, angles out of range, a point that is not on the surface, zero normal, zero-length axis,
/// wrong number of children, nesting deeper than 64, control points. Between two parts of a region the context may stop it.
std::vector<PointId> select(const Region& region, const Mesh& mesh, const std::string& what, const RunContext& context = {});

/// The control points that handles select from.
struct ControlSet {
  std::size_t size = 0;  ///< number of control points
  /// Numbers of control points along each axis, if they form a lattice: (i, j, k) of an l x m x n lattice has the number
  /// i + l (j + m k).
  std::optional<std::array<std::size_t, 3>> lattice = std::nullopt;
};

/// The numbers of the selected control points, sorted and unique; may be empty. Throws Error(invalid_argument) naming `what` and
/// the field: a kind that selects points of the mesh, numbers out of range, first > last, a range without a lattice, and the
/// errors of select() for combinators.
std::vector<PointId> select_controls(const Region& region, const ControlSet& controls, const std::string& what,
                                     const RunContext& context = {});

/// The message for a region that selects no point: "its region contains no point; the model's box is [0, 0, 0] to [1, 2, 3]".
std::string no_point_text(const Mesh& mesh);

}  // namespace deform
