// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "client/cli/commands/workspace.h"
#include "core/mesh/mesh.h"

namespace deform::cli {

/// Throws Error(invalid_argument) with the reason where a method is no function of the place: shell moves the surface only, and
/// the energies of subspace and mls would change with further points.
void check_space_method(const v1::Method& method);

/// A design of a setup as a function of the place: what the deformation of the mesh does to any point of space. The points travel
/// to the server as further points of the mesh, which no face holds; the regions of the setup are handed over as the points of
/// the mesh that they select, so that none of the others gets into them, and so is the place of an automatic lattice. Each call
/// registers a geometry of its own and deletes it again.
class SpaceDeformation {
 public:
  /// prepared: with its mesh. values: as parse_settings() gives them. Deforms the mesh once. Throws Error(invalid_argument) where
  /// the deformation is no function of the place: method shell, which moves the surface only; subspace and mls, whose energies
  /// would change with the points; planes of symmetry that are given by a region.
  SpaceDeformation(Connection& connection, const PreparedSetup& prepared, const std::vector<double>& values);

  /// Where the points go. Throws what the server says, and Error(failed_precondition) when a design is bad.
  Points operator()(std::span<const Vec3> points);

  /// The largest distance between a point of the mesh as the setup deforms it and as it went with the points so far, model units:
  /// 0 up to rounding, unless centres were chosen or systems were solved to a tolerance.
  double mesh_difference() const { return difference_; }
  const v1::DesignResult& result() const { return result_; }  ///< of the mesh

 private:
  Points deformed(const std::string& system);
  Vec3 mirrored(Vec3 point, std::vector<int>& planes) const;

  Connection& connection_;
  const v1::Setup setup_;
  const std::shared_ptr<const Mesh> mesh_;
  const std::vector<double> values_;
  v1::Setup extended_;
  std::vector<Group> regions_;
  struct Plane {
    Vec3 point, normal;  ///< the mesh is where the normal points
  };
  std::vector<Plane> planes_;
  Points moved_mesh_;
  v1::DesignResult result_;
  double difference_ = 0;
  int calls_ = 0;
};

}  // namespace deform::cli
