// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <utility>
#include <vector>

#include "core/cad/model.h"

namespace deform::cad {

/// Faces that have a name of their own in both files, before and after.
std::vector<std::array<int, 2>> common_names(const Model& before, const Model& after);

constexpr int unpainted = -1;

/// The colours of the faces of both models as numbers that they share, `unpainted` where there is none: colours that differ by
/// less than 0.01 in each channel are one. Both are empty where a model has no colours.
std::pair<std::vector<int>, std::vector<int>> numbered_colours(const Model& before, const Model& after);

}  // namespace deform::cad
