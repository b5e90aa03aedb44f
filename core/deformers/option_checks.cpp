// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/option_checks.h"

#include <cstdio>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/problems.h"

namespace deform {

void refuse_argument(const std::string& message) { throw Error(ErrorCode::invalid_argument, message); }

void check_option_range(double value, double least, double most, const std::string& field) {
  if (value >= least && value <= most) return;
  refuse_argument(field + ": " + number_digits(value) + " is out of range " + number_digits(least) + ".." + number_digits(most));
}

void check_option_range(Problems& problems, double value, double least, double most, const std::string& field) {
  problems.check(field, [&] { check_option_range(value, least, most, field); });
}

std::optional<std::string> units_note(const std::string& what, double diagonal, double of_mesh) {
  const double ratio = of_mesh > 0 ? diagonal / of_mesh : 1;
  if (!(ratio > most_size_ratio || ratio < 1 / most_size_ratio)) return std::nullopt;
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", ratio);
  return "The diagonal of the " + what + " is " + text + " times that of the mesh: are both in the same units?";
}

}  // namespace deform
