// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>

namespace deform::bench {

/// What the reduction of centres to a tolerance costs and changes: four setups whose regions keep a gap, refined step by step,
/// with centres to the tolerance, in three rings, and (as far as that is affordable) all of them. `data` is the folder of shared
/// meshes; without it the generated meshes alone are measured.
enum class ReductionSizes { small, usual, large };
void centre_reduction(ReductionSizes sizes, const std::filesystem::path& data);

}  // namespace deform::bench
