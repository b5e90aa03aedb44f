// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <set>

#include "core/base/run_context.h"
#include "core/cad/model.h"

namespace deform::cad {

/// Pairs of faces of a model, by number from 0, the lower one first, that go through each other though they have no vertex in
/// common: their triangulations, which are up to `deflection` (model units) from them, cross. Faces that touch do not count,
/// unless their triangulations cross. Leaves no triangulation in the model.
std::set<std::array<int, 2>> crossing_faces(const Model& model, double deflection, const RunContext& context);

}  // namespace deform::cad
