// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <spdlog/common.h>

#include <charconv>
#include <chrono>
#include <cstddef>
#include <string>
#include <system_error>

#include "core/base/error.h"

namespace deform::server {

// Values of options as they are written. All parsers throw Error(invalid_argument) that shows the text.

/// The whole text as a number of the type.
template <typename T>
T parse_number(const std::string& text) {
  T value{};
  const auto [end, failure] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (failure != std::errc() || end != text.data() + text.size()) {
    throw Error(ErrorCode::invalid_argument, "\"" + text + "\" is not a number that fits here");
  }
  return value;
}

/// 0 to 86400, with digits behind the point.
std::chrono::milliseconds parse_seconds(const std::string& text);
std::string to_seconds(std::chrono::milliseconds time);

/// "4GiB", "512 MiB", "1.5GB", "123456" -> bytes. Units: B; K, M, G, T or KiB, MiB, GiB, TiB, powers of 1024; kB, MB, GB, TB,
/// powers of 1000.
std::size_t parse_bytes(const std::string& text);
/// The shortest of these forms that gives exactly the same number.
std::string to_text(std::size_t bytes);

spdlog::level::level_enum parse_level(const std::string& text);
std::string to_text(spdlog::level::level_enum level);

}  // namespace deform::server
