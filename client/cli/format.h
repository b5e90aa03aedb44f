#pragma once

#include <cstdint>
#include <string>

namespace deform::cli {

/// "12.3 MiB"
std::string bytes_text(std::uint64_t bytes);
/// "1.23 s", "4 min", "2 h"
std::string duration_text(double seconds);
/// Shortest form that reads well: 6 significant digits.
std::string number_text(double value);

}  // namespace deform::cli
