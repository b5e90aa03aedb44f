// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/size_text.h"

#include <algorithm>
#include <charconv>
#include <map>
#include <system_error>

#include "core/base/error.h"

namespace deform::server {

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
  if (failure != std::errc() || end != text.data() + digits || value * found->second > 0x1p60) throw not_a_size;
  return static_cast<std::size_t>(value * found->second);
}

}  // namespace deform::server
