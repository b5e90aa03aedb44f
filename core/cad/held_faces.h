// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <Geom_ElementarySurface.hxx>
#include <gp_Trsf.hxx>
#include <optional>
#include <string>

#include "core/cad/face_region.h"
#include "core/cad/mesh_motion.h"
#include "core/cad/model.h"

namespace deform::cad {

/// Places before and after, as columns.
struct PlaceSamples {
  Eigen::Matrix3Xd before, after;
};

/// How the nodes of a face go: rigidly, or to a surface of its analytic type.
struct HeldFace {
  gp_Trsf motion{};
  Handle(Geom_ElementarySurface) surface{};  ///< null: rigidly
};

/// Throws Error(invalid_argument) where the model does not lie at the boundary of the mesh: fewer than a tenth of its vertices
/// are within a twentieth of its diagonal from a node. Of a half, quarter or eighth of the model a part of them are. scale: from
/// the unit of the model to that of the mesh.
void check_place(const Model& model, const MeshMotion& mesh, double scale);

/// A sentence for the user where nodes on the boundary of the mesh lie in the box of the model, but not on its faces: then it may
/// be another variant of the model. Up to 500 of them, evenly spread over their numbers, are measured; those within 1e-4 D count
/// as nodes on the model. Nothing where all are on it, also where the mesh is that of a part of the model. A pure function.
std::optional<std::string> doubt_of_place(const Model& model, const MeshMotion& mesh, double scale);

/// Finds the faces whose nodes hold them: all nodes of the mesh on the face, its boundary included, move rigidly or end on a
/// surface of its type, exactly or as near as a constraint on them reports. Immutable; any thread may call.
class HeldFaces {
 public:
  /// scale: from the unit of the model to that of the mesh. limit: how far between the nodes the deformation may differ from what
  /// they do, model units. Keeps references.
  HeldFaces(const Model& model, const MeshMotion& mesh, double scale, double limit);

  /// samples: points of the face and where the deformation takes them; nothing where they are farther than the limit from what
  /// the nodes do, or there are too few nodes to tell.
  std::optional<HeldFace> held(int f, const FaceRegion& region, const PlaceSamples& samples) const;

 private:
  std::vector<PointId> nodes_on(int f, const FaceRegion& region) const;
  double allowance(const std::vector<PointId>& nodes) const;

  const Model& model_;
  const MeshMotion& mesh_;
  const double scale_, limit_;
};

}  // namespace deform::cad
