// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "core/cad/correspondence.h"
#include "core/cad/edge_map.h"
#include "core/cad/face_warp.h"
#include "core/cad/model.h"

namespace deform::cad {

/// FaceWarp of a face that is closed across a seam which does not go to the seam of its partner: (u, v) of it are places on a
/// cylinder around which the periodic one runs, where r^2 log r with {1, x, y, z} takes the other edges to those of the partner.
/// Immutable.
class PeriodicWarp {
 public:
  /// edges: of all edges of the old model; samples: how many each edge gets at least; loose: seams that are left out.
  PeriodicWarp(const Model& before, const Model& after, const Correspondence& partners, int face,
               const std::vector<EdgeMap>& edges, const std::vector<int>& samples, const std::vector<char>& loose);
  Parameters operator()(const Parameters& uv) const;

 private:
  Eigen::Vector3d place(const Parameters& uv) const;

  int around_ = 0;                 ///< 0: u is periodic, 1: v
  double period_ = 1, slope_ = 1;  ///< of the old face; of the new parameter around by the old one
  double radius_ = 1, along_ = 1;  ///< of the cylinder; length of a step along it
  std::vector<Eigen::Vector3d> centres_;
  Eigen::MatrixX2d weights_;  ///< n + 4; of the shifts from (slope_ u, v)
};

}  // namespace deform::cad
