// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <array>
#include <span>
#include <string>
#include <vector>

#include "core/base/types.h"
#include "core/cad/model.h"

namespace deform::cad {

/// Faces, edges, vertices, wires and solids of a model as one graph, in this order.
struct ModelGraph {
  std::vector<std::vector<int>> neighbours;
  std::vector<std::vector<int>> kinds;  ///< what an entity is, beside its neighbours: faces by
                                        ///< their type and whether they bulge, loops by whether they are the outer one of a plane
  std::vector<Vec3> places;             ///< of faces (centroid), edges and vertices (middle), in the unit of the model
  std::vector<Vec3> normals;            ///< of faces that are planes, out of the solid; else 0
  std::vector<std::array<int, 2>> ends;  ///< of edges: nodes of the graph of first and last vertex, -1: none
  int first_edge = 0, first_vertex = 0, first_wire = 0, first_solid = 0;
  Vec3 centre{};    ///< mean of the places of the faces
  double size = 0;  ///< root mean square distance of the faces from it; D for a single face

  int size_of_graph() const { return static_cast<int>(kinds.size()); }
  std::string name(const Model& model, int node) const;  ///< "face 12 (cylinder)", "edge 3", "vertex 1", "a loop or solid"
  std::string bulge(int face) const;                     ///< " and is hollow", " and bulges", or nothing
  std::string loops(int face) const;                     ///< "2 loops of 5 edges in all"
};

/// left_out: faces are all of one kind, and so are loops.
enum class FaceTypes { known, left_out };
ModelGraph graph_of(const Model& model, FaceTypes types = FaceTypes::known);

/// The kinds of the faces with their types.
std::vector<std::vector<int>> kinds_of_faces(const Model& model);

/// How the old model is laid over the new one before places are compared: x -> scale * turn * (x - from) + to.
struct Placement {
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  double scale = 1;
  Vec3 from{}, to{};
};

/// The placement by a similarity without reflection that takes places and normals of the old faces, edges and vertices nearest to
/// those of their partners (Kabsch 1976, Umeyama 1991). pairs: the partner of each node of the old graph, -1: none yet.
Placement best_placement(const ModelGraph& before, const ModelGraph& after, std::span<const int> pairs);

}  // namespace deform::cad
