// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <span>

#include "tests/bench/report.h"

namespace deform::bench {

/// How far MLS with its default samples is from its limit on real closed surfaces: twice as many samples must move no point by
/// more than 1 % of the largest prescribed displacement, and if all handles move by one affine map, all points must follow it to
/// 1e-9 of the diagonal. With the time and the memory of both numbers. Needs the folder of real meshes (DEFORM_SHARED_DATA);
/// `names` are those of its surfaces, or all that are closed if there is none.
void measure_sample_doubling(std::span<const char* const> names, Report& report);

}  // namespace deform::bench
