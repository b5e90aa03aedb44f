// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>
#include <vector>

#include "core/constraints/detection/detect.h"

namespace deform::detection {

/// Names of what was found: kind, measure, number among those with the same kind and measure, as in "cylinder_d12.5_1",
/// "sphere_d40_1", "cone_a60_1" (opening angle in degrees), "plane_z0.3_1" (at right angles to an axis: the place on it),
/// "plane_oblique_1", "line_l20_1", "circle_d8_2", "arc_d8_1". Only letters, digits, '_', '.' and '-'.
void set_names(Detection& detection);

/// The shortest decimal number within `off` of the value, "12.5" of 12.4998, without an exponent where that is short. off >= 0;
/// at most 17 digits.
std::string short_number(double value, double off);

}  // namespace deform::detection
