// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>

#include "tests/bench/report.h"

namespace deform::bench {

/// What the check of the cells costs beside the designs that it looks at: car_fastback, its roof lifted with the handle basis.
/// The answers are compared with those of every cell on its own.
void cell_check_cost(const std::filesystem::path& car_case, Report& report);

}  // namespace deform::bench
