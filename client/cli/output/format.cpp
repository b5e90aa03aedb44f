// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/output/format.h"

#include <cstdio>
#include <ctime>

namespace deform::cli {

namespace {

std::string formatted(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof(text), format, value);
  return text;
}

}  // namespace

std::string bytes_text(std::uint64_t bytes) {
  const char* units[] = {"bytes", "KiB", "MiB", "GiB", "TiB"};
  double value = static_cast<double>(bytes);
  int unit = 0;
  while (value >= 1024 && unit < 4) {
    value /= 1024;
    ++unit;
  }
  return formatted(unit == 0 ? "%.0f " : "%.1f ", value) + units[unit];
}

std::string duration_text(double seconds) {
  if (seconds < 0.001) return formatted("%.0f us", seconds * 1e6);
  if (seconds < 1) return formatted("%.1f ms", seconds * 1e3);
  if (seconds < 120) return formatted("%.1f s", seconds);
  if (seconds < 7200) return formatted("%.0f min", seconds / 60);
  return formatted("%.1f h", seconds / 3600);
}

std::string date_text(std::int64_t unix_ms) {
  if (unix_ms == 0) return "-";
  const auto seconds = static_cast<std::time_t>(unix_ms / 1000);
  std::tm local{};
  char text[40];
  if (localtime_r(&seconds, &local) == nullptr) return "-";
  std::string date(text, std::strftime(text, sizeof(text), "%Y-%m-%dT%H:%M:%S%z", &local));
  if (date.size() > 2) date.insert(date.size() - 2, ":");
  return date;
}

std::string number_text(double value) { return formatted("%.6g", value); }

}  // namespace deform::cli
