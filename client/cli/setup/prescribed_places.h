// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <span>
#include <string>
#include <vector>

#include "core/base/types.h"
#include "core/mesh/mesh.h"
#include "deform/v1/setup.pb.h"

namespace deform::cli {

/// The map of positions that the variables give a handle: one value each, in their order. Throws Error(invalid_argument) for a
/// value out of its bounds and for a motion that is none.
Affine handle_motion(const v1::Setup& setup, const std::string& handle, std::span<const double> values);

/// Distance of points from the positions that a design prescribes.
struct Misfit {
  double largest = 0, rms = 0;  ///< model units
  PointId point = 0;            ///< the point with the largest distance
};

/// Positions prescribed by handles and fixed regions.
class PrescribedPlaces {
 public:
  /// Selects the points. The mesh must outlive the object. Throws Error(invalid_argument) as select() does.
  PrescribedPlaces(const v1::Setup& setup, const Mesh& mesh);

  /// The misfit of the points of all handles and fixed regions when all points are at `points` (n), for variables (one value
  /// each). Zero without any. Throws as handle_motion().
  Misfit misfit(std::span<const double> values, std::span<const Vec3> points) const;

 private:
  const v1::Setup& setup_;
  const Mesh& mesh_;
  std::vector<std::vector<PointId>> handles_;
  std::vector<PointId> fixed_;
};

}  // namespace deform::cli
