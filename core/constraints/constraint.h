// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "core/base/types.h"
#include "core/constraints/projection.h"

namespace deform {

/// The coordinates in which constraints are evaluated: model = origin + scale * unit, scale > 0. A ConstraintKind is in model
/// units; the points passed to make_projection() and to the projections are in unit coordinates.
struct UnitMap {
  Vec3 origin{};
  double scale = 1;
};

enum class Size { free, kept };  ///< kept: as fitted to the rest points

enum class Bound { equal, minimum, maximum };

// The kinds of geometric constraints (thesis 8.5.2, and relations between regions). Each takes one region unless
// stated otherwise.

/// All points in one plane, which is fitted. At least 4 points.
struct Planar {};
/// All points on one circle. At least 4 points.
struct Circular {
  Size radius = Size::free;
};
/// All points on one infinite circular cylinder. At least 6 points.
struct Cylindrical {
  Size radius = Size::free;
};
/// All points on one sphere. At least 5 points.
struct Spherical {
  Size radius = Size::free;
};
/// All points on one nappe of a circular cone. At least 7 points.
struct Conical {
  Size angle = Size::free;  ///< half the opening angle
};
/// All points on one straight line. At least 3 points.
struct Straight {};
/// The rest shape up to a translation, rotation and uniform scaling (no reflection). At least 3 points.
struct FeatureLine {};
/// The rest shape up to a translation and rotation. At least 2 points.
struct Rigid {
  /// If positive, the constraint does not apply to the region itself, but to each column of this many cells that stands on a face
  /// of it; each column is rigid on its own (thesis 8.6.3). The region must contain all corners of some boundary faces of a
  /// volume mesh. At most 1000. See core/mesh/wall_columns.h.
  int layers = 0;
};
/// The points slide in a given plane. At least 1 point.
struct FixedPlane {
  Vec3 point{}, normal{};  ///< the normal need not be of unit length
};
/// One region that is its own mirror image, or two regions that are mirror images of each other, in a plane that is fitted.
/// Pairs of points are determined at rest: every point needs exactly one partner (possibly itself) within `tolerance`. At least
/// 3 points.
struct Symmetric {
  struct Plane {
    Vec3 point{}, normal{};
  };
  /// The plane at rest. If not set, it is perpendicular to the line between the means of two regions, or for one region
  /// perpendicular to its longest principal axis for which all points have partners (points without distinct axes need a
  /// given plane).
  std::optional<Plane> plane;
  double tolerance = 1e-3;  ///< as a fraction of the bounding-box diagonal of its points; 0 < tolerance <= 0.1
};
/// Two or more regions in one plane. At least 4 points.
struct Coplanar {};
/// Each region in a plane of its own, with all planes parallel. Two or more regions, at least 3 points each.
struct Parallel {};
/// Each of two regions in a plane, with perpendicular planes. At least 3 points each.
struct Orthogonal {};
/// The distance between two regions, such as the thickness of a wall or a gap. It applies to each pair of points that are nearest
/// to each other at rest; other points are not constrained. The distance of a pair is kept, or is at least or at most `value`.
/// Two regions without common points. Distances are measured between points, so the regions should have similar mesh density.
struct Distance {
  Bound bound = Bound::equal;
  std::optional<double> value;  ///< > 0; if not set, the distance of each pair at rest
};
/// A bound of the extent of a region along an axis. maximum: all points lie between two planes perpendicular to the axis at
/// distance `value`. minimum: the points that form the upper and the lower end at rest (within `ends` of the rest extent) stay
/// above and below such a pair of planes. `equal` is not allowed. At least 2 points.
struct Extent {
  Vec3 axis{};  ///< need not be of unit length
  Bound bound = Bound::minimum;
  double value = 0;    ///< >= 0
  double ends = 0.01;  ///< as a fraction of the rest extent, 0 <= ends < 0.5; for minimum only
};

using ConstraintKind = std::variant<Planar, Circular, Cylindrical, Spherical, Conical, Straight, FeatureLine, Rigid, FixedPlane,
                                    Symmetric, Coplanar, Parallel, Orthogonal, Distance, Extent>;

/// The name of the alternative in snake case: "planar", "circular", ..., "symmetric", "distance", "extent".
std::string_view kind_name(const ConstraintKind& kind);

/// The options of a constraint as numbers, so that two constraints of a kind can be compared. Directions are not normalized.
std::vector<double> numbers_of(const ConstraintKind& kind);

/// What becomes of a constraint where the model continues as its mirror image.
enum class Mirroring {
  shape,      ///< its points fit one shape, which may continue through the plane
  relation,   ///< it relates points to each other: what lies on the plane belongs to both sides
  direction,  ///< it names a plane or an axis: the mirror image has that of its own
};
Mirroring mirroring_of(const ConstraintKind& kind);

/// The places and directions that the options of a constraint name.
struct Placement {
  std::vector<Vec3*> points, directions;  ///< parts of the options
};
Placement placement_of(ConstraintKind& kind);

/// The smallest and the largest number of regions of a kind.
std::array<std::size_t, 2> region_counts(const ConstraintKind& kind);

/// The smallest number of points of a kind, over all regions together.
std::size_t least_points(const ConstraintKind& kind);

/// Creates the projection of a constraint. `rest` holds the rest points of each region in unit coordinates; they need not satisfy
/// the constraint. The projection takes the points of all regions in order; a point of two regions occurs twice, and each copy
/// has its own target. Throws Error(invalid_argument) with a message that starts with `what` ("constraints[2]") and names the
/// field: wrong number of regions, too few points (with the limit), non-finite numbers, zero normal or axis, bounds out of range,
/// points without a mirror image (with their number and the first), Size::kept for coplanar points. O(n log n).
std::unique_ptr<const Projection> make_projection(const ConstraintKind& kind, std::span<const std::vector<Vec3>> rest,
                                                  const UnitMap& units = {}, const std::string& what = "constraint");

}  // namespace deform
