// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>

#include "tests/bench/report.h"

namespace deform::bench {

/// The roof of a car lifted in the polyhedral mesh around it by moving least squares with 5000 samples on the surface and 2000 in
/// the volume, the outer box fixed, without and with rigid columns of three cells on the body (thesis 8.6.3, figure 8.14).
/// Writes cases under `work`.
void rigid_layers(const std::filesystem::path& car_case, const std::filesystem::path& work, Report& report);

}  // namespace deform::bench
