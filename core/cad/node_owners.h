// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <span>
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

/// The owners of the nodes of a mesh. A node belongs to a vertex or edge within 1e-6 D, or within 1/50 of the shortest side of a
/// face of the mesh at it and the tolerance, which files with few digits need; else to the nearest face in whose trimmed region
/// it lies. Throws Error(invalid_argument) with the ids of nodes that are farther than `tolerance` from the model.
std::vector<Owner> owners_of(const Model& model, const Mesh& mesh, std::span<const PointId> nodes, double tolerance,
                             const RunContext& context);

}  // namespace deform::cad
