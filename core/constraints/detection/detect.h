// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/mesh/mesh.h"

namespace deform {

enum class PrimitiveKind { plane, cylinder, sphere, cone };
enum class EdgeKind { line, circle, arc };

/// "plane", "cylinder", "sphere", "cone"; "line", "circle", "arc".
std::string_view to_string(PrimitiveKind kind);
std::string_view to_string(EdgeKind kind);

struct DetectOptions {
  /// How far a point of a primitive may be from it, model units. Every primitive tightens this to four times the rms distance of
  /// its own points, so that what runs on tangentially (a fillet beside a plane) is not swallowed. 0: 1e-3 of the size of the
  /// surface, or five times its noise where that is more.
  double tolerance = 0;
  /// Smallest area of a primitive, as a fraction of the area of the surface, below 1. 0: 0.01.
  double minimum_area = 0;
  /// Greatest angle between faces side by side in one curved primitive, radians, below pi / 2; greater ones are sharp edges. 0:
  /// 0.6, so that 11 flat strips around (32.7 degrees), as coarse meshes of small bores have them, are a cylinder and 10 are as
  /// many planes.
  double maximum_angle = 0;
  std::uint64_t seed = 0;
  /// What to look for; empty: all kinds.
  std::vector<PrimitiveKind> kinds;

  /// Throws Error(invalid_argument) naming the field and its limits.
  void validate() const;
};

/// Faces that lie on one plane, cylinder, sphere or cone, connected across edges that are not sharp. Patches of the same surface
/// are one primitive when they touch, and, of cylinders, spheres and cones, also when they lie around the same stretch of the
/// axis (a bore that is cut by slots); two bores one behind the other stay two, and so do coplanar faces that do not touch.
struct Primitive {
  PrimitiveKind kind = PrimitiveKind::plane;
  /// "plane_z0.3_1", "cylinder_d12.5_1", ...: kind, measure (see detection/names.h), then counted by falling area
  std::string name;
  Vec3 point{};                 ///< in the plane, on the axis beside the middle of the faces, the centre of the sphere, the apex
  Vec3 axis{};                  ///< unit normal or axis (cone: from the apex into it); zero for a sphere
  double radius = 0;            ///< of cylinder and sphere
  double half_angle = 0;        ///< of the cone, radians, 0..pi / 2
  std::vector<FaceId> faces;    ///< ascending; every face belongs to one primitive at most
  std::vector<PointId> points;  ///< all points of these faces, ascending; a point on an edge belongs to several primitives
  double area = 0;
  double rms = 0, max = 0;  ///< distance of the points from the primitive
  std::string constraint;   ///< constraint_kind(), or empty where the points are fewer than it takes
  /// Names of the sets whose constraints together imply that of this one (see detection/implied.h); mostly none.
  std::vector<std::string> implied_by;
};

/// A stretch of sharp edges, or of edges between two primitives, that is straight or circular.
struct EdgeFeature {
  EdgeKind kind = EdgeKind::line;
  std::string name;             ///< "line_l20_1", "circle_d8_1", "arc_d8_1", ...: kind, measure, then counted by falling length
  std::vector<PointId> points;  ///< in order along the curve, each once; of a circle the last is joined to the first
  Vec3 point{};                 ///< the first point of a line, the centre of a circle or arc
  Vec3 axis{};                  ///< unit direction of a line, unit normal of the plane of a circle or arc
  double radius = 0;            ///< of circle and arc
  double length = 0;            ///< of the polygon
  double rms = 0, max = 0;      ///< distance of the points from the curve
  std::string constraint;       ///< as of a primitive
  std::vector<std::string> implied_by;  ///< as of a primitive
  std::vector<std::string> lies_on;     ///< names of the primitives that have all its points
};

struct Detection {
  std::vector<Primitive> primitives;  ///< planes, cylinders, spheres, cones, each by falling area
  std::vector<EdgeFeature> edges;     ///< lines, circles, arcs
  // What the values 0 of the options became, in the same units.
  double tolerance = 0;
  double minimum_area = 0;
  double maximum_angle = 0;
  double size = 0;      ///< twice the greatest distance of a corner from the middle of the surface: does not change with rotation
  double noise = 0;     ///< estimated standard deviation of points from a smooth surface
  double area = 0;      ///< of all faces
  double coverage = 0;  ///< fraction of it that belongs to primitives
  std::vector<std::string> notes;
};

/// Finds the primitives of a surface (thesis 8.5.3) from normals of the faces and the corners they belong to: smooth patches
/// between sharp edges, then seeds where the curvature changes least, each with samples of its surroundings (Fischler and Bolles
/// 1981), grow with a threshold that follows the residual of what they hold (forward search: Atkinson et al. 2004, Fleishman et
/// al. 2005), on fine meshes first over clusters of faces, of which the smallest primitive has a few hundred; residuals that are
/// not noise but a shape of their own (a torus taken for a cylinder) refuse the primitive. Then neighbours compete for the faces
/// between them. For volume meshes: of the boundary. Coincident points count as one here. Points without faces and faces without
/// area are legal; the latter go with their neighbours. Same result for the same seed and any number of threads. Throws
/// Error(invalid_argument) for bad options and a mesh without any area, Error(cancelled), deadline_exceeded. Reports "detect".
Detection detect(const Mesh& mesh, const DetectOptions& options, const RunContext& context = {});

/// What a constraint on the points of such a primitive is called: "planar", "cylindrical", "spherical", "conical"; of edges
/// "straight" and "circular".
std::string_view constraint_kind(PrimitiveKind kind);
std::string_view constraint_kind(EdgeKind kind);

/// count colours (red, green, blue) that differ as far as their number allows, always the same; never grey, which is left for
/// what belongs to no primitive.
std::vector<std::array<unsigned char, 3>> distinct_colours(std::size_t count);

}  // namespace deform
