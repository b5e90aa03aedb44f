// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "client/cli/commands/workspace.h"
#include "core/base/types.h"
#include "core/cad/mesh_motion.h"

namespace deform::cli {

/// Throws Error(invalid_argument) with the reason for the shell, which moves the surface of a mesh only.
void check_space_method(const v1::Setup& setup);

/// A design of a prepared setup as a function of the place: what it does to any point of space, by the call Evaluate of the
/// server. Nothing is registered.
class SpaceDeformation {
 public:
  /// values: as parse_settings() gives them. Deforms the mesh once and compares some of its points with where the function takes
  /// them. Throws what the server says, and Error(failed_precondition) when the design is bad.
  SpaceDeformation(Connection& connection, const PreparedSetup& prepared, const std::vector<double>& values);

  /// Where the points go, model units. Throws what the server says: Error(failed_precondition) with the reason where the method
  /// has no such function.
  Points operator()(std::span<const Vec3> points);

  /// The largest distance between a point of the mesh as the setup deforms it and as the function does, model units: 0, or the
  /// tolerance of an iterative solver.
  double mesh_difference() const { return difference_; }
  std::size_t still() const { return still_; }  ///< points outside of a lattice so far, which stay at rest
  /// The mesh at rest and deformed, its boundary, and what constraints on planes, cylinders, cones and spheres report.
  cad::MeshMotion mesh_motion(const PreparedSetup& prepared) const;

 private:
  void compare(const PreparedSetup& prepared);

  Connection& connection_;
  v1::EvaluateHeader header_;
  v1::DesignResult result_;  ///< of the mesh
  Points moved_mesh_;
  double difference_ = 0;
  std::size_t still_ = 0;
};

}  // namespace deform::cli
