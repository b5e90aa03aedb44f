// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <Geom2d_Curve.hxx>
#include <array>
#include <vector>

#include "core/cad/correspondence.h"
#include "core/cad/edge_map.h"
#include "core/cad/model.h"

namespace deform::cad {

using Parameters = std::array<double, 2>;  ///< (u, v)

/// Curve of a use of an edge in (u, v) of a face; a seam has one for each sense. Null where there is none.
Handle(Geom2d_Curve) curve_of(const Model& model, int face, const Coedge& use);

/// Mean lengths of a step of u and of v, divided by the size of the face.
std::array<double, 2> parameter_lengths(const TopoDS_Face& face);

/// The map of (u, v) of a face to those of its partner that takes boundary to boundary (thesis 6.2): r^2 log r and {x, y, 1} in
/// metric lengths, through samples of all edges. Immutable.
class FaceWarp {
 public:
  /// edges: of all edges of the old model; samples: how many each edge gets at least.
  FaceWarp(const Model& before, const Model& after, const Correspondence& partners, int face, const std::vector<EdgeMap>& edges,
           const std::vector<int>& samples);
  Parameters operator()(const Parameters& uv) const;

 private:
  Eigen::Vector2d scaled(const Parameters& uv) const { return {uv[0] * scale_[0], uv[1] * scale_[1]}; }

  std::array<double, 2> scale_{1, 1};
  std::vector<Eigen::Vector2d> centres_;  ///< empty: the identity
  Eigen::MatrixX2d weights_;              ///< n + 3
};

}  // namespace deform::cad
