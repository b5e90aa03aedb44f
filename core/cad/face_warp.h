// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Geom2d_Curve.hxx>
#include <array>
#include <vector>

#include "core/cad/correspondence.h"
#include "core/cad/edge_map.h"
#include "core/cad/model.h"
#include "core/cad/thin_plate.h"

namespace deform::cad {

using Parameters = std::array<double, 2>;  ///< (u, v)

/// Curve of a use of an edge in (u, v) of a face; a seam has one for each sense. Null where there is none.
Handle(Geom2d_Curve) curve_of(const Model& model, int face, const Coedge& use);

/// Mean lengths of a step of u and of v, divided by the size of the face.
std::array<double, 2> parameter_lengths(const TopoDS_Face& face);

/// A place on the boundary of a face and where it goes on that of its partner, both in (u, v).
struct BoundaryPair {
  Parameters from{}, to{};
};

/// Pairs of samples along all edges of a face, at most one at each place in (u, v) scaled by `scale`. edges: maps of all edges of
/// the old model; samples: how many each edge gets at least.
std::vector<BoundaryPair> boundary_pairs(const Model& before, const Model& after, const Correspondence& partners, int face,
                                         const std::vector<EdgeMap>& edges, const std::vector<int>& samples,
                                         const std::array<double, 2>& scale);

/// The map of (u, v) of a face to those of its partner that takes boundary to boundary (thesis 6.2): r^2 log r and {x, y, 1} in
/// metric lengths, through samples of all edges. Immutable.
class FaceWarp {
 public:
  /// As boundary_pairs().
  FaceWarp(const Model& before, const Model& after, const Correspondence& partners, int face, const std::vector<EdgeMap>& edges,
           const std::vector<int>& samples);
  Parameters operator()(const Parameters& uv) const;

 private:
  std::array<double, 2> scale_{1, 1};
  ThinPlate shift_;
};

}  // namespace deform::cad
