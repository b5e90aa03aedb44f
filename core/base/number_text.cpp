// SPDX-License-Identifier: Apache-2.0
#include "core/base/number_text.h"

#include <charconv>
#include <cmath>
#include <cstdio>

namespace deform {

std::string number_digits(double value) {
  char text[32];
  // By default to_chars() writes 100000 as 1e+05, which is shorter.
  const double magnitude = std::abs(value);
  const bool plain = magnitude >= 1e-4 && magnitude < 1e9;
  const auto written = plain ? std::to_chars(text, text + sizeof(text), value, std::chars_format::fixed)
                             : std::to_chars(text, text + sizeof(text), value);
  return {text, written.ptr};
}

std::string three_digits(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

std::string mebibytes(std::size_t bytes) {
  char text[32];
  if (bytes > 0 && bytes < (std::size_t{1} << 20)) {
    std::snprintf(text, sizeof(text), "%.1f KiB", static_cast<double>(bytes) / 1024.0);
    return text;
  }
  std::snprintf(text, sizeof(text), "%.1f MiB", static_cast<double>(bytes) / (1024.0 * 1024.0));
  return text;
}

}  // namespace deform
