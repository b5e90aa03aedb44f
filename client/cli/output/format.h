// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <string>

namespace deform::cli {

/// "12.3 MiB"
std::string bytes_text(std::uint64_t bytes);
/// "1.23 s", "4 min", "2 h"
std::string duration_text(double seconds);
/// ISO 8601 in local time, "2026-11-22T08:15:00+01:00"; "-" for 0, which means unknown.
std::string date_text(std::int64_t unix_ms);
/// Shortest form that reads well: 6 significant digits.
std::string number_text(double value);

}  // namespace deform::cli
