// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <filesystem>
#include <vector>

namespace deform::bench {

/// What the reduction of centres to a tolerance costs and changes: four setups whose regions keep a gap, refined step by step,
/// with centres to the tolerance, in three rings, and (as far as that is affordable) all of them. `data` is the folder of shared
/// meshes; without it the generated meshes alone are measured.
enum class ReductionSizes { small, usual };
void centre_reduction(ReductionSizes sizes, const std::filesystem::path& data);

/// The same of the README's setup on its own meshes of these sizes, ascending, each made anew: whether its result settles, the
/// misfit at joins as a fraction of the shortest edge there, times and memory.
void large_reductions(const std::vector<std::size_t>& sizes);

}  // namespace deform::bench
