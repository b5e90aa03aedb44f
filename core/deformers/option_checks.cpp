// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/option_checks.h"

#include "core/base/error.h"
#include "core/base/number_text.h"

namespace deform {

void refuse_argument(const std::string& message) { throw Error(ErrorCode::invalid_argument, message); }

void check_option_range(double value, double least, double most, const std::string& field) {
  if (value >= least && value <= most) return;
  refuse_argument(field + ": " + number_digits(value) + " is out of range " + number_digits(least) + ".." + number_digits(most));
}

}  // namespace deform
