// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <vector>

namespace deform {

/// `most` of the numbers 0 .. count - 1, one at a pseudo-random place of every part of equal length; all of them when there are
/// no more. Ascending, the same every time. Equal steps would meet the rows of a structured mesh always in the same column.
std::vector<std::size_t> stratified_numbers(std::size_t count, std::size_t most);

}  // namespace deform
