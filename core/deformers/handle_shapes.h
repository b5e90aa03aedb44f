// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>
#include <vector>

#include "core/deformers/setup.h"
#include "core/deformers/system.h"

namespace deform {

/// The handles that a design mirrors, that is turns inside out, or flattens, one sentence each and at most four: "handle "root"
/// is mirrored by fat = -2: its linear map has determinant -1". What follows is moved as it was asked for, but rarely as it was
/// meant. See compiled::shape_under() for the limit. Handles with displacements are not looked at. Throws the errors of
/// handle_motions(). Any thread.
std::vector<std::string> handle_shape_doubts(const Setup& setup, const Design& design);

}  // namespace deform
