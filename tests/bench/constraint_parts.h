// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <filesystem>

#include "tests/bench/constraint_cases.h"

namespace deform::bench {

/// A_surface/joint_remeshed of the shared meshes: bottom fixed, top lifted by 0.3, the two circles of the bore between them as
/// detection finds them (thesis figure 8.9).
ConstraintCase joint_case(const std::filesystem::path& data);

/// A_surface/fandisk: one end fixed, the other moved sideways; between them a plane and the longest feature lines, as detection
/// finds them (thesis figure 8.8).
ConstraintCase fandisk_case(const std::filesystem::path& data);

/// A_surface/car_fastback with about so many points, or without a folder of shared meshes an Ahmed body.
Mesh car_body(const std::filesystem::path& data, std::size_t points);

/// Its front stretched by 0.3 m, the rims of the front wheelhouses circular (thesis figure 8.11); of the Ahmed body the front
/// stilts cylindrical. One variable, "stretch".
ConstraintCase stretched_car(const std::filesystem::path& data, std::size_t points);

}  // namespace deform::bench
