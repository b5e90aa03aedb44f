// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/mesh/mesh.h"

namespace deform::cad {

/// Two entities that are partners by decision of the user, as they are numbered in the files, from 1.
struct ForcedPair {
  enum class Kind { face, edge, vertex };
  Kind kind = Kind::face;
  int before = 0, after = 0;
};

/// What carries the nodes of a mesh from one CAD model to another.
struct MoveRequest {
  std::filesystem::path before, after;  ///< .step .stp .iges .igs .brep: the model at which the mesh is, and where it goes
  std::vector<ForcedPair> pairs;        ///< partners that are given instead of found
  /// Both models are multiplied by it to have the unit of the mesh; > 0. Where the files name different units, the new model is
  /// first brought to that of the old one.
  double scale = 1;
  /// Largest distance of a node of the boundary from the old model, model units; 0: automatic, 1e-4 D of the old model.
  double tolerance = 0;
  /// For each face of the mesh the entity on which it lies, such as the tag of a surface in Gmsh, 0: none; empty: not known.
  /// Those that lie on one face of the old model hold their nodes to it, where another one is as near.
  std::vector<std::int32_t> face_entities;
};

/// What became of the nodes of one face.
struct FaceOutcome {
  int before = 0, after = 0;  ///< numbers from 1 in both models
  std::string type;           ///< "plane", "cylinder", ...
  std::size_t nodes = 0;      ///< inside the face, without those of its edges
  double largest = 0;         ///< displacement of a node, edges included, model units
  std::size_t triangles = 0;  ///< of the mesh on this face; see boundary_triangles(), without those of no area
  std::size_t flipped = 0;    ///< of these, those that lie the other way round on the new face
  std::size_t outside = 0;    ///< nodes in triangles that left the trimmed face by more than 1e-9 D
  std::size_t warp_flipped = 0, warp_outside = 0;  ///< the same before nodes were slid to mend it
};

/// Nodes of a mesh on the new CAD model.
struct CarriedNodes {
  std::vector<PointId> nodes;      ///< of the boundary, ascending
  Points places;                   ///< of these nodes on the new model, model units
  std::vector<FaceOutcome> faces;  ///< one per face of the old model
  std::vector<std::string> notes;  ///< whole sentences: units, healing, merged faces
  double diagonal = 0;             ///< D of the new model, model units
  double farthest = 0;             ///< distance of a node from the old model, model units
  double distance = 0;             ///< largest distance of a checked node from the new entity that holds it
  std::size_t checked = 0;         ///< nodes for which that was measured
  std::size_t on_vertices = 0, on_edges = 0, on_faces = 0;  ///< where the nodes are
  /// The sum over all faces.
  std::size_t flipped() const {
    std::size_t sum = 0;
    for (const FaceOutcome& face : faces) sum += face.flipped;
    return sum;
  }
  /// The sum over all faces.
  std::size_t outside() const {
    std::size_t sum = 0;
    for (const FaceOutcome& face : faces) sum += face.outside;
    return sum;
  }
};

/// Carries the nodes on the boundary of a mesh from the old CAD model to the new one (thesis 6.2). Vertices, edges and faces are
/// paired by structure: colour refinement of the incidences of faces, loops, edges and vertices, with the types of the faces,
/// tells apart what it can; among the rest the positions decide, after a translation and a scaling. Nodes on edges keep the
/// fraction of the edge's parameter, or of its arc length when the type of the curve changed. Nodes inside faces follow a warp of
/// (u, v) in metric lengths by r^2 log r with {x, y, 1} that takes the boundary of the old face to that of the new one, or the
/// normals of the old face where its type changed or both are free forms and triangles keep their shapes better so; around
/// triangles that it flips and nodes that leave the trimmed face, nodes are slid on the surface until there are none
/// (face_mending.h), and what is left is counted. A node whose place on the model does not change stays as it
/// is. Deterministic. Any thread may call, one at a time: reading sets global options of OpenCASCADE.
///
/// Throws Error(not_found, invalid_argument): a file that cannot be read or holds no face, nodes that are farther from the old
/// model than the tolerance (with their ids), numbers of pairs out of range. Error(failed_precondition): the models have no
/// common structure, or more than one correspondence fits (naming faces); no OpenCASCADE in this program. Error(cancelled,
/// deadline_exceeded) by the context.
CarriedNodes carry_nodes(const Mesh& mesh, const MoveRequest& request, const RunContext& context = {});

}  // namespace deform::cad
