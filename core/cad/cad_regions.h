// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/mesh/mesh.h"

namespace deform::cad {

/// What finds the nodes of a mesh on the faces and edges of its CAD model.
struct RegionsRequest {
  std::filesystem::path model;  ///< .step .stp .iges .igs .brep
  double scale = 1;             ///< from the unit of the model to that of the mesh; > 0
  double tolerance = 0;         ///< largest distance of a node of the boundary from the model, unit of the mesh; 0: 1e-4 D
};

/// Faces on one surface that touch each other, or an edge; lengths in the unit of the mesh.
struct CadShape {
  enum class Kind { plane, cylinder, cone, sphere, other_face, line, circle, other_edge };
  Kind kind = Kind::other_face;
  std::string name;             ///< as in the file where it is unique there, else type and number: "cylinder_7", "line_12"
  std::string type;             ///< "plane", "B-spline", ..., of edges "line", "circle", "curve"
  std::vector<int> numbers;     ///< from 1, of the faces in the order of the file, or of the edge
  Vec3 point{};                 ///< on the plane, on the axis, centre, apex of a cone; start of a line
  Vec3 axis{};                  ///< unit normal or direction, of a cone from the apex into it; 0 of spheres and other types
  double radius = 0;            ///< of cylinder, sphere and circle
  double half_angle = 0;        ///< of a cone, radians
  double size = 0;              ///< area or length
  double rms = 0, largest = 0;  ///< distances of the points from it; 0 of other types
  bool closed = false;          ///< of an edge: a whole circle
  std::vector<PointId> points;  ///< of the mesh on it, its boundary included, ascending
  std::vector<int> lies_on;     ///< of an edge: the faces that it bounds, as indices
};

/// A plane in which the model is its own mirror image.
struct MirrorPlane {
  Vec3 point{}, normal{};
};

/// What a mesh has of its CAD model.
struct CadRegions {
  std::vector<CadShape> faces, edges;  ///< by their first numbers; edges inside of a shape are left out
  std::vector<MirrorPlane> mirrors;
  std::vector<std::string> notes;  ///< whole sentences
  double diagonal = 0, area = 0;   ///< of the model
  double farthest = 0;             ///< distance of a node from the model
  std::size_t nodes = 0;           ///< on the model: those of the boundary of the mesh
};

/// The nodes on the boundary of a mesh by the faces and edges of its CAD model, with the shapes of these. A node on an edge
/// belongs to its faces, too. Neighbouring faces on one cylinder, cone, sphere or plane are one shape. Planes of symmetry are
/// looked for through the middle of the bounding box across the axes of coordinates, and through the centroid of the surface
/// across its principal axes, and tested with vertices and points of all faces up to 1e-6 D. Deterministic. Any thread may call,
/// one at a time.
///
/// Throws Error(not_found, invalid_argument): a file that cannot be read or holds no face, a mesh without faces and cells, nodes
/// that are farther from the model than the tolerance (with their ids). Error(failed_precondition): no OpenCASCADE in this
/// program. Error(cancelled, deadline_exceeded) by the context.
CadRegions cad_regions(const Mesh& mesh, const RegionsRequest& request, const RunContext& context = {});

}  // namespace deform::cad
