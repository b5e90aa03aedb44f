// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/cad/correspondence.h"
#include "core/cad/edge_map.h"
#include "core/cad/model.h"

namespace deform::cad {

/// One line for the file of a model that cad-apply made from another: how many entities both have, and sums of the places of
/// their faces, weighted by their numbers. By it cad-move knows that faces of equal numbers are partners with the same (u, v),
/// whatever became of their types, and that both files are still as they were then. Lengths in the unit of the files.
std::string derivation(const Model& before, const Model& after);

/// The partners in a model whose file has such a line, if it was made from `before`: faces by their numbers; edges and vertices,
/// which readers of STEP reorder, by their faces and their places in (u, v). Nothing where the line is missing, says other counts
/// or places, or what is found is no isomorphism. The scale of models is taken out.
std::optional<Correspondence> derived_partners(const Model& before, const Model& after);

/// Whether points of a face have the (u, v) of their partners, up to what fitting leaves: it became a spline, or its edges lie
/// where they lay in (u, v). Not where cad-apply kept its type with other dimensions. edges: of all edges of the old model.
bool keeps_parameters(const Model& before, const Model& after, const Correspondence& partners, int face,
                      const std::vector<EdgeMap>& edges);

}  // namespace deform::cad
