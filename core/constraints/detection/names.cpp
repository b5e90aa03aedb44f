// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/detection/names.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <numbers>

#include "core/base/error.h"

namespace deform::detection {

namespace {

constexpr double relative_off = 1e-3;      ///< four significant digits at most
constexpr double along_axis = 1 - 1.6e-5;  ///< cosine of a third of a degree

std::string text_of(double value, std::chars_format format, int precision) {
  char text[64];
  const auto [end, failure] = std::to_chars(std::begin(text), std::end(text), value, format, precision);
  if (failure != std::errc()) throw Error(ErrorCode::internal, "detection: a number does not fit its text");
  return {std::begin(text), end};
}

/// Numbers that are measured on points are no better than their distances from the shape.
std::string measure(double value, double rms) { return short_number(value, std::max(relative_off * std::abs(value), rms)); }

std::string stem(char letter, const std::string& number) { return std::string(1, letter).append(number); }

std::string measure_of(const Primitive& primitive, double size) {
  constexpr double degrees = 180 / std::numbers::pi;
  switch (primitive.kind) {
    case PrimitiveKind::plane:
      for (std::size_t k = 0; k < 3; ++k) {
        if (std::abs(primitive.axis[k]) < along_axis) continue;
        return stem("xyz"[k], short_number(primitive.point[k], std::max(relative_off * size / 2, primitive.rms)));
      }
      return "oblique";
    case PrimitiveKind::cylinder:
    case PrimitiveKind::sphere:
      return stem('d', measure(2 * primitive.radius, primitive.rms));
    case PrimitiveKind::cone:
      return stem('a', short_number(2 * primitive.half_angle * degrees, 0.05));
  }
  return {};
}

std::string measure_of(const EdgeFeature& edge) {
  return edge.kind == EdgeKind::line ? stem('l', measure(edge.length, edge.rms)) : stem('d', measure(2 * edge.radius, edge.rms));
}

}  // namespace

std::string short_number(double value, double off) {
  constexpr int most_digits = 17;
  constexpr double smallest_plain = 1e-4, largest_plain = 1e7;
  if (std::abs(value) <= off) return "0";
  for (int digits = 1; digits <= most_digits; ++digits) {
    const std::string scientific = text_of(value, std::chars_format::scientific, digits - 1);
    double rounded = 0;
    std::from_chars(scientific.data(), scientific.data() + scientific.size(), rounded);
    if (std::abs(rounded - value) > off && digits < most_digits) continue;
    const double magnitude = std::abs(rounded);
    if (magnitude >= smallest_plain && magnitude < largest_plain) {
      const int exponent = static_cast<int>(std::floor(std::log10(magnitude) + 1e-12));
      return text_of(rounded, std::chars_format::fixed, std::max(0, digits - 1 - exponent));
    }
    const std::size_t e = scientific.find('e');
    const int exponent = std::stoi(scientific.substr(e + 1));
    return scientific.substr(0, e).append("e").append(std::to_string(exponent));
  }
  return {};
}

void set_names(Detection& detection) {
  std::map<std::string, std::size_t> counts;
  const auto numbered = [&](const std::string& stem) { return stem + "_" + std::to_string(++counts[stem]); };
  for (Primitive& p : detection.primitives) {
    p.name = numbered(std::string(to_string(p.kind)) + "_" + measure_of(p, detection.size));
  }
  for (EdgeFeature& e : detection.edges) e.name = numbered(std::string(to_string(e.kind)) + "_" + measure_of(e));
}

}  // namespace deform::detection
