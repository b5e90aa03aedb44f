// SPDX-License-Identifier: Apache-2.0
#include "core/io/text/fitted_decimal.h"

#include <charconv>
#include <cmath>
#include <cstdlib>

namespace deform::io {

namespace {

constexpr int shortest = -1;  // instead of a number of decimals: as many as needed

std::string digits_of(double size, std::chars_format format, int decimals) {
  char buffer[512];  // the largest double has 309 digits in front of its point
  const auto result = decimals == shortest ? std::to_chars(buffer, buffer + sizeof buffer, size, format)
                                           : std::to_chars(buffer, buffer + sizeof buffer, size, format, decimals);
  return {buffer, result.ptr};
}

/// Drops trailing zeros of a fraction, and characters that the style does not need.
std::string tidied(std::string digits, DecimalStyle style) {
  if (digits.find('.') == std::string::npos) digits += '.';
  digits.erase(digits.find_last_not_of('0') + 1);
  if (style == DecimalStyle::abaqus && digits.back() == '.') digits.pop_back();
  if (style == DecimalStyle::nastran && digits.size() > 2 && digits.starts_with("0.")) digits.erase(0, 1);
  return digits;
}

std::string fixed(double value, int decimals, DecimalStyle style) {
  std::string text(std::signbit(value) ? "-" : "");
  text += tidied(digits_of(std::abs(value), std::chars_format::fixed, decimals), style);
  return text;
}

std::string scientific(double value, int decimals, DecimalStyle style) {
  const std::string digits = digits_of(std::abs(value), std::chars_format::scientific, decimals);
  const std::size_t e = digits.find('e');
  const int exponent = std::atoi(digits.c_str() + e + 1);
  std::string text(std::signbit(value) ? "-" : "");
  text += tidied(digits.substr(0, e), style);
  if (style == DecimalStyle::abaqus) {
    text += 'e';
  } else if (exponent >= 0) {
    text += '+';
  }
  return text + std::to_string(exponent);
}

/// With as many decimals as fit; nothing when none does.
template <typename Write>
std::optional<std::string> with_most_decimals(std::size_t width, const Write& write) {
  for (int decimals = static_cast<int>(width); decimals >= 0; --decimals) {
    std::string text = write(decimals);
    if (text.size() <= width) return text;
  }
  return std::nullopt;
}

}  // namespace

std::optional<double> parse_decimal(std::string_view token, DecimalStyle style) {
  constexpr std::size_t longest = 64;
  if (token.empty() || token.size() > longest) return std::nullopt;
  if (token[0] == '+' && !token.starts_with("+-")) token.remove_prefix(1);
  std::string text;
  for (const char c : token) {
    const bool sign = c == '+' || c == '-';
    if (c == 'd' || c == 'D' || c == 'E') {
      text += 'e';
    } else if (style == DecimalStyle::nastran && sign && !text.empty() && text.back() != 'e') {
      text += 'e';
      text += c;
    } else {
      text += c;
    }
  }
  const std::size_t first = text.starts_with("-") ? 1 : 0;
  if (first == text.size() || !((text[first] >= '0' && text[first] <= '9') || text[first] == '.')) return std::nullopt;
  double value = 0;
  const auto [end, status] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (end != text.data() + text.size()) return std::nullopt;
  if (status == std::errc::result_out_of_range) {
    value = std::strtod(text.c_str(), nullptr);  // tiny numbers are out of range too; this rounds them
  } else if (status != std::errc{}) {
    return std::nullopt;
  }
  return std::isfinite(value) ? std::optional(value) : std::nullopt;
}

std::optional<std::string> fitted_decimal(double value, std::size_t width, DecimalStyle style) {
  const double size = std::abs(value);
  constexpr double longest_fixed = 1e40, finest_fixed = 1e-40;  // beyond, far from any width
  const bool try_fixed = size == 0 || (size < longest_fixed && size > finest_fixed);
  std::string text = scientific(value, shortest, style);
  if (try_fixed) {
    std::string other = fixed(value, shortest, style);
    if (other.size() <= text.size()) text = std::move(other);
  }
  if (text.size() <= width) return text;
  std::optional<std::string> best;
  double least = 0;
  const auto consider = [&](const std::optional<std::string>& candidate) {
    if (!candidate) return;
    const auto parsed = parse_decimal(*candidate, style);
    if (!parsed) return;
    const double error = std::abs(*parsed - value);
    if (best && error >= least) return;
    best = candidate;
    least = error;
  };
  if (try_fixed) consider(with_most_decimals(width, [&](int decimals) { return fixed(value, decimals, style); }));
  consider(with_most_decimals(width, [&](int decimals) { return scientific(value, decimals, style); }));
  return best;
}

}  // namespace deform::io
