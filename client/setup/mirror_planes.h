// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "core/base/types.h"
#include "core/mesh/mesh.h"
#include "deform/v1/setup.pb.h"

namespace deform::client {

/// A symmetry plane of a half model; the normal is of unit length.
struct MirrorPlane {
  /// Points of the region of a plane lie in it up to this fraction of the diagonal.
  static constexpr double flatness = 1e-6;

  Vec3 point{}, normal{};
  Vec3 reflected(const Vec3& x) const;
};

/// The symmetry planes of a setup: those that are given, and those of regions that are perpendicular to an axis. Of other regions
/// there is none here, nor of a sector. Throws what select() throws.
std::vector<std::optional<MirrorPlane>> mirror_planes(const v1::Setup& setup, const Mesh& mesh);

/// The points and faces of a mesh and of its images in these planes; those in a plane occur twice. There must be a plane for
/// each.
Mesh whole_model(const Mesh& mesh, const std::vector<std::optional<MirrorPlane>>& planes);

}  // namespace deform::client
