// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <span>
#include <string>
#include <vector>

#include "core/cad/cad_move.h"
#include "core/cad/model.h"
#include "core/cad/model_graph.h"

namespace deform::cad {

/// Partners of the entities of the old model in the new one, numbers from 0.
struct Correspondence {
  std::vector<int> faces, edges, vertices;
  std::vector<int> face_senses;    ///< 1: (u, v) of both faces have the same handedness seen from outside, -1: the opposite
  std::vector<int> edge_senses;    ///< 1: both edges run the same way, -1: the opposite one
  std::vector<std::string> notes;  ///< whole sentences: what decided where structure left a choice
  /// Edges and faces have the parameters of their partners, see derivation.h.
  bool same_parameters = false;
};

/// Pairs the entities of two models. The result is an isomorphism of the incidences of solids, faces, loops, edges and vertices
/// that keeps the types of the faces, bores and bosses, outer loops of planes and the way the loops run. Where there are several,
/// these decide, the first that has a clear answer: how many entities stay in place; sums of squared distances as the models lie
/// in their files and after a translation and a scaling; the same after the similarity that fits best; names that single faces
/// have in both files, and colours that as many faces have among those that may be partners. An answer is clear if no other that
/// was found comes near. Distances in the files that speak against what stays, and a similarity that fits far better, are a veto,
/// which names and colours overrule where they leave no choice; names and colours that say otherwise than a clear answer are one
/// as well. Where pairs are given, only the first is. Notes name what names and colours say otherwise than the result.
/// types: left_out: the partner of a face may also be a spline surface or another without a shape of its own, or have been one; a
/// plane is no partner of a cylinder all the same.
/// Throws Error(failed_precondition) naming faces when there is no way, none that is clear, or a contradiction;
/// Error(invalid_argument) for pairs out of range.
Correspondence match_models(const Model& before, const Model& after, std::span<const ForcedPair> pairs,
                            FaceTypes types = FaceTypes::known);

/// Whether colour refinement distinguishes the incidences of two models.
bool structures_differ(const Model& before, const Model& after, FaceTypes types = FaceTypes::known);

/// How many planes have normals that turn by more than 45 degrees from a face to its partner, as a share of all.
double turned_planes(const Model& before, const Model& after, const Correspondence& partners);

}  // namespace deform::cad
