// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cmath>
#include <random>

#include "core/base/types.h"

namespace deform {

/// A curved patch of n points, about 4 x 2 x 1 units, and a smooth bump on it.
struct BumpField {
  Points registered, deformed;
  double diagonal = 0;
};

inline BumpField bump_field(std::size_t n, Vec3 origin = {0, 0, 0}) {
  BumpField field;
  const auto columns = static_cast<std::size_t>(std::sqrt(static_cast<double>(n)) + 1);
  for (std::size_t i = 0; i < n; ++i) {
    const double u = static_cast<double>(i % columns) / static_cast<double>(columns);
    const double v = static_cast<double>(i / columns) / static_cast<double>(columns);
    const double bump = std::exp(-10 * ((u - 0.5) * (u - 0.5) + (v - 0.5) * (v - 0.5)));
    const Vec3 p{origin[0] + 4 * u, origin[1] + 2 * v, origin[2] + std::sin(5 * u) * std::cos(3 * v)};
    field.registered.push_back(p);
    field.deformed.push_back({p[0] + 0.02 * bump, p[1] - 0.05 * bump * u, p[2] + 0.1 * bump});
  }
  field.diagonal = bounding_box(field.registered).diagonal();
  return field;
}

/// Points that have nothing to do with each other, displaced by up to `range`.
inline BumpField noise_field(std::size_t n, double range, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(-1, 1);
  BumpField field;
  for (std::size_t i = 0; i < n; ++i) {
    const Vec3 p{unit(random), unit(random), unit(random)};
    field.registered.push_back(p);
    field.deformed.push_back({p[0] + range * unit(random), p[1] + range * unit(random), p[2] + range * unit(random)});
  }
  field.diagonal = bounding_box(field.registered).diagonal();
  return field;
}

}  // namespace deform
