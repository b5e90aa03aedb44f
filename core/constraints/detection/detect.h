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
  /// Largest distance of a point from its primitive, in model units. Each primitive tightens it to four times the rms distance of
  /// its own points, so that it does not absorb tangential neighbours (a fillet next to a plane). 0 means 1e-3 of the size of the
  /// surface or five times its noise, whichever is larger.
  double tolerance = 0;
  /// Smallest area of a primitive, as a fraction of the area of the surface, below 1. 0 means 0.01.
  double minimum_area = 0;
  /// Largest angle between adjacent faces of a curved primitive, in radians, below pi / 2; edges with larger angles are sharp. 0
  /// means 0.6, so that a coarse bore of 11 flat strips (32.7 degrees) is a cylinder, but one of 10 strips is 10 planes.
  double maximum_angle = 0;
  std::uint64_t seed = 0;
  /// The kinds to detect; empty means all.
  std::vector<PrimitiveKind> kinds;

  /// Throws Error(invalid_argument) naming the field and its limits.
  void validate() const;
};

/// Faces that lie on one plane, cylinder, sphere or cone, connected across edges that are not sharp. Patches of the same surface
/// are one primitive if they touch. For cylinders, spheres and cones they are also one if they lie around the same section of the
/// axis (a bore cut by slots). Two bores one behind the other remain two primitives, and so do coplanar faces that do not touch.
struct Primitive {
  PrimitiveKind kind = PrimitiveKind::plane;
  /// "plane_z0.3_1", "cylinder_d12.5_1", ...: kind, dimension (see detection/names.h), and a number by descending area.
  std::string name;
  Vec3 point{};                 ///< on the plane; on the axis next to the middle of the faces; centre of the sphere; apex
  Vec3 axis{};                  ///< unit normal or axis (cone: from the apex into it); zero for a sphere
  double radius = 0;            ///< radius of cylinder and sphere
  double half_angle = 0;        ///< half the opening angle of the cone, radians, 0..pi / 2
  std::vector<FaceId> faces;    ///< ascending; each face belongs to at most one primitive
  std::vector<PointId> points;  ///< all points of these faces, ascending; a point on an edge belongs to several primitives
  double area = 0;
  double rms = 0, max = 0;  ///< distance of the points from the primitive
  std::string constraint;   ///< constraint_kind(), or empty if there are too few points for it
  /// Names of the sets whose constraints together imply this one's (see detection/implied.h); usually empty.
  std::vector<std::string> implied_by;
};

/// A straight or circular chain of sharp edges, or of edges between two primitives.
struct EdgeFeature {
  EdgeKind kind = EdgeKind::line;
  std::string name;             ///< "line_l20_1", "circle_d8_1", "arc_d8_1", ...: kind, dimension, number by descending length
  std::vector<PointId> points;  ///< in order along the curve, each once; a circle closes from the last to the first
  Vec3 point{};                 ///< the first point of a line, the centre of a circle or arc
  Vec3 axis{};                  ///< unit direction of a line, unit normal of the plane of a circle or arc
  double radius = 0;            ///< radius of circle and arc
  double length = 0;            ///< length of the polyline
  double rms = 0, max = 0;      ///< distance of the points from the curve
  std::string constraint;       ///< as of a primitive
  std::vector<std::string> implied_by;  ///< as of a primitive
  std::vector<std::string> lies_on;     ///< names of the primitives that have all its points
};

struct Detection {
  std::vector<Primitive> primitives;  ///< planes, cylinders, spheres, cones, each by descending area
  std::vector<EdgeFeature> edges;     ///< lines, circles, arcs
  // The options in effect, after replacing zeros by defaults, in the same units.
  double tolerance = 0;
  double minimum_area = 0;
  double maximum_angle = 0;
  double size = 0;   ///< twice the largest distance of a corner from the centre of the surface, which is invariant under rotation
  double noise = 0;  ///< estimated standard deviation of points from a smooth surface
  double area = 0;   ///< area of all faces
  double coverage = 0;  ///< fraction of the area that belongs to primitives
  std::vector<std::string> notes;
};

/// Finds the primitives of a surface (thesis 8.5.3), or of the boundary of a volume mesh, from its corners and face normals.
/// Regions grow from smooth patches between sharp edges, then from seeds where the curvature changes least, with samples of
/// their neighbourhood (Fischler and Bolles 1981); the distance threshold follows the residual of the current region (forward
/// search: Atkinson et al. 2004, Fleishman et al. 2005). On fine meshes they grow over clusters of faces first, a few hundred
/// for the smallest primitive. A primitive is rejected if its residuals are systematic rather than noise (a torus taken for a
/// cylinder). Finally neighbours compete for the faces between them. Coincident points count as one. Points without faces and
/// faces without area are legal; the latter join their neighbours. The result depends on the seed only, not on the number of
/// threads. Throws Error(invalid_argument) for bad options or a mesh without area, Error(cancelled), deadline_exceeded. Reports
/// "detect" progress.
Detection detect(const Mesh& mesh, const DetectOptions& options, const RunContext& context = {});

/// The name of the constraint for the points of a primitive ("planar", "cylindrical", "spherical", "conical") or of an edge
/// ("straight", "circular").
std::string_view constraint_kind(PrimitiveKind kind);
std::string_view constraint_kind(EdgeKind kind);

/// Returns `count` colours (red, green, blue) that are as distinct as possible and the same in every call. None is grey, which is
/// reserved for faces without a primitive.
std::vector<std::array<unsigned char, 3>> distinct_colours(std::size_t count);

}  // namespace deform
