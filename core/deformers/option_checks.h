// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>

namespace deform {

/// Throws Error(invalid_argument).
[[noreturn]] void refuse_argument(const std::string& message);

/// Refuses a value outside of least..most (not a number is outside), naming the field and the limits.
void check_option_range(double value, double least, double most, const std::string& field);

}  // namespace deform
