// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "core/base/types.h"
#include "core/mesh/mesh.h"

namespace deform {

/// A two-dimensional case: a volume mesh that is one cell thick, between two planes whose faces are of type "empty" (those of
/// OpenFOAM). It must stay so: points move along the planes only, and the two at the ends of an edge between them alike. Meshes
/// without such faces, or with faces in more than two planes, are none. Immutable; any thread.
class FlatCase {
 public:
  static constexpr double flatness = 1e-6;  ///< fraction of D: distance of points from their plane, and from each other along it

  FlatCase() = default;  ///< none
  explicit FlatCase(const Mesh& mesh);

  bool exists() const { return exists_; }
  const Vec3& normal() const { return normal_; }  ///< unit

  /// Why a displacement, or its rate, leads out of the planes, with what to do: "leaves the plane ...". Empty if it does not by
  /// more than 1e-9 of `size`, that of its terms, in the same unit.
  std::string leaves(const Vec3& displacement, double size) const;
  /// The first of these points (ascending) whose partner in the other plane is not among them: "point 3 is in the region, but not
  /// point 12 ...", with what to do; empty if there is none.
  std::string one_sided(const std::vector<PointId>& ids) const;

 private:
  bool exists_ = false;
  Vec3 normal_{};
  std::vector<PointId> partner_;  ///< n; itself if there is none
};

}  // namespace deform
