// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/option_text.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

namespace deform::server {

std::string to_text(std::size_t size) {
  static constexpr std::pair<std::size_t, const char*> units[] = {
      {std::size_t{1} << 40, "TiB"}, {std::size_t{1} << 30, "GiB"}, {std::size_t{1} << 20, "MiB"}, {std::size_t{1} << 10, "KiB"}};
  for (const auto& [unit, name] : units) {
    if (size >= unit && size % unit == 0) return std::to_string(size / unit) + name;
  }
  return std::to_string(size);
}

std::size_t parse_bytes(const std::string& text) {
  static const std::map<std::string, double> units = {{"", 1.0},
                                                      {"B", 1.0},
                                                      {"KiB", 1024.0},
                                                      {"MiB", 1048576.0},
                                                      {"GiB", 1073741824.0},
                                                      {"TiB", 1099511627776.0},
                                                      {"K", 1024.0},
                                                      {"M", 1048576.0},
                                                      {"G", 1073741824.0},
                                                      {"T", 1099511627776.0},
                                                      {"k", 1024.0},
                                                      {"m", 1048576.0},
                                                      {"g", 1073741824.0},
                                                      {"t", 1099511627776.0},
                                                      {"kB", 1e3},
                                                      {"MB", 1e6},
                                                      {"GB", 1e9},
                                                      {"TB", 1e12}};
  const std::size_t digits = std::min(text.find_first_not_of("0123456789."), text.size());
  std::size_t unit = digits;
  while (unit < text.size() && text[unit] == ' ') ++unit;
  const auto found = units.find(text.substr(unit));
  const Error not_a_size{ErrorCode::invalid_argument, "\"" + text + "\" is not a size such as 512MiB, 4G or 1000000"};
  if (found == units.end() || digits == 0) throw not_a_size;
  double value = 0;
  const auto [end, failure] = std::from_chars(text.data(), text.data() + digits, value);
  const bool part_of_a_byte = found->second == 1 && text.find('.') < digits;
  if (part_of_a_byte || failure != std::errc() || end != text.data() + digits || value * found->second > 0x1p60) throw not_a_size;
  return static_cast<std::size_t>(value * found->second);
}

std::chrono::milliseconds parse_seconds(const std::string& text) {
  const auto seconds = parse_number<double>(text);
  if (!(seconds >= 0 && seconds <= 86'400)) {
    throw Error(ErrorCode::invalid_argument, "\"" + text + "\" is not a number of seconds, 0 to 86400");
  }
  return std::chrono::milliseconds(std::llround(seconds * 1e3));
}

std::string to_seconds(std::chrono::milliseconds time) { return fmt::format("{}", static_cast<double>(time.count()) / 1e3); }

spdlog::level::level_enum parse_level(const std::string& text) {
  const auto level = spdlog::level::from_str(text);
  if (level == spdlog::level::off && text != "off") {
    throw Error(ErrorCode::invalid_argument, "\"" + text + "\" is none of trace, debug, info, warning, error, critical, off");
  }
  return level;
}

std::string to_text(spdlog::level::level_enum level) {
  const auto name = spdlog::level::to_string_view(level);
  return {name.data(), name.size()};
}

}  // namespace deform::server
