// SPDX-License-Identifier: GPL-3.0-or-later
#include <cmath>

#include "core/constraints/detection/detect.h"

namespace deform {

namespace {

/// Hue in turns, saturation and value 0..1 (Smith 1978).
std::array<unsigned char, 3> colour(double hue, double saturation, double value) {
  std::array<unsigned char, 3> rgb{};
  for (int k = 0; k < 3; ++k) {
    const double place = std::fmod(hue * 6 + (k == 0 ? 5 : k == 1 ? 3 : 1), 6.0);
    const double part = value * (1 - saturation * std::fmax(0, std::fmin(1, std::fmin(place, 4 - place))));
    rgb[static_cast<std::size_t>(k)] = static_cast<unsigned char>(std::lround(255 * part));
  }
  return rgb;
}

}  // namespace

std::vector<std::array<unsigned char, 3>> distinct_colours(std::size_t count) {
  // The golden section spreads any number of hues; neighbours in the list also differ in strength.
  constexpr double golden = 0.6180339887498949;
  std::vector<std::array<unsigned char, 3>> colours(count);
  for (std::size_t i = 0; i < count; ++i) {
    const double hue = std::fmod(0.58 + golden * static_cast<double>(i), 1.0);
    colours[i] = colour(hue, i / 3 % 2 == 0 ? 0.85 : 0.5, i % 3 == 0 ? 0.95 : i % 3 == 1 ? 0.75 : 0.55);
  }
  return colours;
}

}  // namespace deform
