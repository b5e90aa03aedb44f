// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/deformers/setup.h"
#include "core/mesh/mesh.h"

// What a setup will do with its mesh, as known before anything is prepared: numbers in other units than those of the mesh are
// seen there. `regions` are those of validate(). Any thread.

namespace deform {

/// How far the bounds of a variable move the points of its handles, model units: the largest displacement of a point of any of
/// them with the other variables at 0. std::nullopt where a bound is infinite, and where handles select control points. Throws
/// cancelled, deadline_exceeded.
std::vector<std::optional<double>> variable_reaches(const Mesh& mesh, const Setup& setup, const SelectedRegions& regions,
                                                    const RunContext& context = {});

/// One sentence for each of at most 100 variables, "Variable mid_up: bounds move points by up to 30 (0.05 D).", followed by what
/// is rarely meant: rotations beyond one turn or, in radians, half a turn, scales whose lower bound is -1 or less, and bounds
/// that move points by less than 1e-4 D or more than D.
std::vector<std::string> variable_notes(const Mesh& mesh, const Setup& setup, const SelectedRegions& regions,
                                        const RunContext& context = {});

/// A sentence where a surface without symmetry planes looks like half of a model: it has an open rim, all of it lies in one side
/// of the bounding box (up to 1e-6 D), and some of it in no fixed region. Else empty. Not for meshes with cells or without faces;
/// edges at seams, whose points only share places, count as open.
std::string half_model_note(const Mesh& mesh, const Setup& setup, const SelectedRegions& regions);

}  // namespace deform
