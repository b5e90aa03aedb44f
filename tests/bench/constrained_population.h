// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>

#include "tests/bench/report.h"

namespace deform::bench {

/// A round hole in a plate that stays round in a population of 15 designs, which four clients with connections of their own ask a
/// deformd process for at once, one by one. Works in `folder`, which is emptied first.
enum class BenchSize { full, quick };
void constrained_population(const std::filesystem::path& folder, BenchSize size, Report& report);

}  // namespace deform::bench
