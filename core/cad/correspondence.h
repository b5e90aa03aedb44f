// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <span>
#include <string>
#include <vector>

#include "core/cad/cad_move.h"
#include "core/cad/model.h"

namespace deform::cad {

/// Partners of the entities of the old model in the new one, numbers from 0.
struct Correspondence {
  std::vector<int> faces, edges, vertices;
  std::vector<int> face_senses;    ///< 1: (u, v) of both faces have the same handedness seen from outside, -1: the opposite
  std::vector<int> edge_senses;    ///< 1: both edges run the same way, -1: the opposite one
  std::vector<std::string> notes;  ///< whole sentences: what decided where structure left a choice
};

/// Pairs the entities of two models. The result is an isomorphism of the incidences of solids, faces, loops, edges and vertices
/// that keeps the types of the faces and the way the loops run. Where there are several, they are compared by the sums of squared
/// distances of the entities in three views: as the models lie in their files, after a translation and a scaling, and after the
/// similarity that fits best. A view has a say where its best way is clearly better than any other that was found. The first two
/// come first; where both have a say and differ, the first one counts if a face stays in place. The third one decides where the
/// others have no say, and is a veto where it fits far better. Names that single faces have in both files decide last, and are a
/// veto as well. Throws Error(failed_precondition) naming faces when there is no way, none that is clear, or a contradiction;
/// Error(invalid_argument) for pairs out of range.
Correspondence match_models(const Model& before, const Model& after, std::span<const ForcedPair> pairs);

}  // namespace deform::cad
