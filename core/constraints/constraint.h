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

/// Coordinates in which constraints are evaluated: model = origin + scale * unit, scale > 0. Everything in a ConstraintKind is in
/// model units; the points handed to make_projection() and to the projections are in unit coordinates.
struct UnitMap {
  Vec3 origin{};
  double scale = 1;
};

enum class Size { free, kept };  ///< kept: as fitted to the points at rest

enum class Bound { equal, minimum, maximum };

// The kinds of geometric constraints (thesis 8.5.2 and relations between regions). One region each unless another number is
// given.

/// All points in one plane, wherever it is. At least 4 points.
struct Planar {};
/// All points on one circle. At least 4 points.
struct Circular {
  Size radius = Size::free;
};
/// All points on one cylinder (round, infinitely long). At least 6 points.
struct Cylindrical {
  Size radius = Size::free;
};
/// All points on one sphere. At least 5 points.
struct Spherical {
  Size radius = Size::free;
};
/// All points on one nappe of a round cone. At least 7 points.
struct Conical {
  Size angle = Size::free;  ///< half the opening angle
};
/// All points on one straight line. At least 3 points.
struct Straight {};
/// The shape at rest, moved, rotated and uniformly scaled (never mirrored). At least 3 points.
struct FeatureLine {};
/// The shape at rest, moved and rotated. At least 2 points.
struct Rigid {
  /// Over 0: not the region itself, but every column of cells that stands on a face of it, this many cells high, is rigid for
  /// itself (thesis 8.6.3). The region holds all corners of faces on the boundary of a volume mesh; at most 1000. See
  /// core/mesh/wall_columns.h.
  int layers = 0;
};
/// The points slide in a given plane. At least 1 point.
struct FixedPlane {
  Vec3 point{}, normal{};  ///< the normal need not be of unit length
};
/// One region that is its own mirror image, or two that are each other's, in a plane that moves along. Which points belong
/// together is found at rest: every point needs exactly one partner (or itself) within `tolerance`. At least 3 points.
struct Symmetric {
  struct Plane {
    Vec3 point{}, normal{};
  };
  /// At rest. Without it: across the line between the means of two regions; of one region across the longest of its principal
  /// axes that does it (points without distinct axes need a plane given).
  std::optional<Plane> plane;
  double tolerance = 1e-3;  ///< of the diagonal of the box of all its points; 0 < tolerance <= 0.1
};
/// Two or more regions in one plane. At least 4 points.
struct Coplanar {};
/// Every region in a plane, all planes parallel. Two or more regions, at least 3 points each.
struct Parallel {};
/// Both regions in a plane, the planes at right angles. Two regions, at least 3 points each.
struct Orthogonal {};
/// The distance between two regions, such as the thickness of a wall or a gap: of every pair of points that are each other's
/// nearest at rest. It is kept, or is at least or at most `value`. Points that are nobody's nearest are not held. Two regions
/// without common points; distances are between points, so meshes of similar density serve best.
struct Distance {
  Bound bound = Bound::equal;
  std::optional<double> value;  ///< > 0; without it that of each pair at rest
};
/// Bounds on how far a region extends along an axis (one bound per constraint). maximum: all points fit between two planes across
/// the axis that are `value` apart. minimum: the points that are the upper and the lower end at rest (within `ends` of the
/// extent at rest) stay on either side of such a pair of planes. There is no equal. At least 2 points.
struct Extent {
  Vec3 axis{};  ///< need not be of unit length
  Bound bound = Bound::minimum;
  double value = 0;    ///< >= 0
  double ends = 0.01;  ///< of the extent at rest, 0 <= ends < 0.5; used by minimum
};

using ConstraintKind = std::variant<Planar, Circular, Cylindrical, Spherical, Conical, Straight, FeatureLine, Rigid, FixedPlane,
                                    Symmetric, Coplanar, Parallel, Orthogonal, Distance, Extent>;

/// "planar", "circular", ..., "symmetric", "distance", "extent": as the alternative is called, in snake case.
std::string_view kind_name(const ConstraintKind& kind);

/// The options of a kind as numbers, so that two constraints of a kind can be compared. Directions as they are given.
std::vector<double> numbers_of(const ConstraintKind& kind);

/// Least and greatest number of regions that a kind takes.
std::array<std::size_t, 2> region_counts(const ConstraintKind& kind);

/// Number of points, of all regions together, below which a kind is refused.
std::size_t least_points(const ConstraintKind& kind);

/// The projection for points whose positions at rest are `rest`: per region its points, in unit coordinates; the projection takes
/// the points of all regions one after the other (a point of two regions stands there twice, and each copy has its own target).
/// Points at rest need not satisfy the constraint. Throws Error(invalid_argument) starting with `what` ("constraints[2]") and
/// naming the field: wrong number of regions, too few points (with the limit), non-finite numbers, zero normal or axis, bounds
/// out of range, points without a mirror image (with their number and the first), a radius to keep of points that are flat.
/// O(n log n).
std::unique_ptr<const Projection> make_projection(const ConstraintKind& kind, std::span<const std::vector<Vec3>> rest,
                                                  const UnitMap& units = {}, const std::string& what = "constraint");

}  // namespace deform
