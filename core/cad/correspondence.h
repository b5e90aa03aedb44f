// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <span>
#include <vector>

#include "core/cad/cad_move.h"
#include "core/cad/model.h"

namespace deform::cad {

/// Partners of the entities of the old model in the new one, numbers from 0.
struct Correspondence {
  std::vector<int> faces, edges, vertices;
  std::vector<int> face_senses;  ///< 1: (u, v) of both faces have the same handedness seen from outside, -1: the opposite
  std::vector<int> edge_senses;  ///< 1: both edges run the same way, -1: the opposite one
};

/// Pairs the entities of two models. The result is an isomorphism of the incidences of solids, faces, loops, edges and vertices
/// that keeps the types of the faces and the way the loops run. Of several the one with the least sum of squared distances of
/// entities, after translation and scaling, is taken if it is clearly less than that of any other that was found. Throws
/// Error(failed_precondition) naming faces when there is none or no clear one; Error(invalid_argument) for pairs out of range.
Correspondence match_models(const Model& before, const Model& after, std::span<const ForcedPair> pairs);

}  // namespace deform::cad
