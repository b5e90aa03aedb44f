// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>
#include <vector>

#include "core/constraints/detection/detect.h"

namespace deform::detection {

/// Sets the names of all primitives and edges: kind, dimension, and number among those of the same kind and dimension, as in
/// "cylinder_d12.5_1", "sphere_d40_1", "cone_a60_1" (opening angle in degrees), "plane_z0.3_1" (perpendicular to an axis, with
/// the coordinate on it), "plane_oblique_1", "line_l20_1", "circle_d8_2", "arc_d8_1". Only letters, digits, '_', '.' and '-'.
void set_names(Detection& detection);

/// The shortest decimal number within `off` >= 0 of the value, such as "12.5" for 12.4998, without an exponent if that is short.
/// At most 17 digits.
std::string short_number(double value, double off);

}  // namespace deform::detection
