// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <vector>

namespace deform {

/// A stratified sample of `most` of the numbers 0 .. count - 1: one at a pseudo-random position in each of `most` parts of equal
/// length, or all numbers if count <= most. Ascending and deterministic. Equal steps would hit the rows of a structured mesh
/// always in the same column.
std::vector<std::size_t> stratified_numbers(std::size_t count, std::size_t most);

}  // namespace deform
