// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "tests/bench/report.h"

namespace deform::bench {

/// How many steps the alternation of thesis 8.5 takes until all constrained points are within 1e-4 D (rms) of the solution, plain
/// and as the solver does it: a circle, a cylinder, nine sets that overlap.
void constraint_convergence(bool quick, Report& report);

}  // namespace deform::bench
