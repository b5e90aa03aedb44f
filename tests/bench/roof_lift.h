// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>

#include "tests/bench/report.h"

namespace deform::bench {

/// The roof of a car lifted in the polyhedral mesh around it, the outer box fixed (thesis 7.3.2, table 7.2): what checkMesh would
/// say before and after, by our measures, and by itself where it is installed. Writes cases under `work`. Two arrangements: the
/// roof as a patch that moves as a whole, and three points of it (the thesis' own).
void roof_lift(const std::filesystem::path& car_case, const std::filesystem::path& work, Report& report);

}  // namespace deform::bench
