// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/cad/model.h"
#include "core/mesh/mesh.h"

namespace deform::cad {

/// The entity of a model that holds a node: the lowest of those that it lies on.
struct Owner {
  enum class Kind { vertex, edge, face };
  Kind kind = Kind::face;
  int index = 0;               ///< from 0
  std::array<double, 2> uv{};  ///< of a face (u, v), of an edge (t, 0)
  double distance = 0;
};

/// What the faces of a mesh say about the faces of the model on which they lie.
struct KnownFaces {
  std::vector<int> of_mesh_face;   ///< from 0; -1: not known; empty: of none
  std::vector<std::string> notes;  ///< whole sentences
};

/// Finds the face of the model for each entity of the mesh, see MoveRequest::face_entities, and for each group with the name of a
/// single face of the model: the only one that its nodes lie on, within the tolerance, and along whose surface its faces lie, as
/// far as up to 100 of its faces show, evenly by their number. Nodes that turn out not to lie on it are sorted by distance.
/// Among several, such as both sides of a sheet, the one on the side to which the faces of all other entities are turned; then
/// the one whose number is the tag, as in meshes that Gmsh made of the file. Tags and names are never taken without this proof;
/// what has none is said and not used.
KnownFaces known_faces(const Model& model, const Mesh& mesh, std::span<const std::int32_t> entities, double tolerance);

/// The owners of the nodes of a mesh. Nodes whose faces are known belong to these, or to edges and vertices that all of them
/// have. A node belongs to a vertex or edge within 1e-6 D, or within 1/50 of the shortest side of a face of the mesh at it and
/// the tolerance, which files with few digits need; else to the nearest face in whose trimmed region it lies. Throws
/// Error(invalid_argument) with the ids of nodes that are farther than `tolerance` from the model.
std::vector<Owner> owners_of(const Model& model, const Mesh& mesh, std::span<const PointId> nodes, double tolerance,
                             const RunContext& context, const KnownFaces& known = {});

}  // namespace deform::cad
