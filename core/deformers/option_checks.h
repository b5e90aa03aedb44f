// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>

namespace deform {

/// Throws Error(invalid_argument) with this message.
[[noreturn]] void refuse_argument(const std::string& message);

/// Throws Error(invalid_argument) naming the field and the limits unless least <= value <= most; NaN is rejected.
void check_option_range(double value, double least, double most, const std::string& field);

}  // namespace deform
