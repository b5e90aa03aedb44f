// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>
#include <vector>

#include "core/base/types.h"

namespace deform::test {

/// What SciPy's RBFInterpolator (kernel cubic, degree 1) makes of the same data.
struct SciPyResult {
  std::string error;  ///< not empty: it could not be run
  Points values;      ///< at the points
  double solve_seconds = 0, evaluate_seconds = 0;
};

/// Runs tests/bench/numerics_scipy.py (`script`) with `python` on files in a temporary folder, which is removed again.
SciPyResult interpolate_with_scipy(const std::string& python, const std::string& script, const Points& centres,
                                   const Points& values, const Points& points);

}  // namespace deform::test
