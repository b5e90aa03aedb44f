// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/ahmed_lattice.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

namespace deform {

namespace {

using namespace ahmed;

double slant_start(double slant_degrees) {
  return ahmed::length - slant_length * std::cos(slant_degrees * std::numbers::pi / 180);
}

/// Ends of the seven segments of x.
std::array<double, 8> x_breaks(double slant_degrees) {
  return {0,
          front_radius,
          stilt_x[0] - block_half,
          stilt_x[0] + block_half,
          stilt_x[1] - block_half,
          stilt_x[1] + block_half,
          slant_start(slant_degrees),
          ahmed::length};
}

int divided(double size, double spacing, int least) { return std::max(least, static_cast<int>(std::lround(size / spacing))); }

}  // namespace

AhmedDivisions AhmedDivisions::for_spacing(double spacing, double slant_degrees) {
  constexpr double front_factor = 0.6;  // the rounded front narrows, and with it the cells
  const auto breaks = x_breaks(slant_degrees);
  const int block = divided(2 * block_half, spacing, 3);
  AhmedDivisions d;
  d.x[0] = divided(front_radius * std::numbers::pi / 2, front_factor * spacing, 4);
  for (int s = 1; s < 7; ++s) d.x[s] = divided(s == 6 ? slant_length : breaks[s + 1] - breaks[s], spacing, 2);
  d.x[2] = d.x[4] = d.y[1] = block;
  d.y[0] = divided(stilt_y - block_half, spacing, 2);
  d.z = divided(height, spacing, 4);
  // Steps of a stilt follow the spacing of the points on its circle.
  const double on_circle = 2 * std::numbers::pi * stilt_radius / (4 * block);
  constexpr double mean_ring_width = 0.022, ring_growth = 1.6, stilt_growth = 1.3, disc_width = 0.0075, disc_shrink = 0.8;
  d.ring = divided(mean_ring_width, ring_growth * on_circle, 1);
  d.stilt = divided(clearance, stilt_growth * on_circle, 2);
  d.disc = divided(disc_width, disc_shrink * on_circle, 1);
  return d;
}

int AhmedDivisions::x_count() const { return std::accumulate(x.begin(), x.end(), 0); }

std::size_t AhmedDivisions::point_count() const {
  const std::size_t nx = x_count(), ny = 2 * static_cast<std::size_t>(y_count()), nz = z;
  const std::size_t box = 2 * ((nx + 1) * (ny + 1) + (nx + 1) * (nz - 1) + (ny - 1) * (nz - 1));
  const std::size_t n = block(), around = 4 * n;
  const std::size_t added = around * (ring + stilt + (disc - 1)) + (n + 1) * (n + 1);
  return box + 4 * added - 4 * (n - 1) * (n - 1);
}

AhmedLattice::AhmedLattice(const AhmedDivisions& divisions, double slant_degrees) {
  const auto breaks = x_breaks(slant_degrees);
  const double slope = std::tan(slant_degrees * std::numbers::pi / 180);
  const double roof = clearance + height;
  for (int s = 0; s < 7; ++s) {
    for (int i = s == 0 ? 0 : 1; i <= divisions.x[s]; ++i) {
      const double t = static_cast<double>(i) / divisions.x[s];
      Station station{i == divisions.x[s] ? breaks[s + 1] : breaks[s] + t * (breaks[s + 1] - breaks[s]), width / 2, clearance,
                      roof};
      if (s == 0) {
        const double angle = t * std::numbers::pi / 2;
        if (i < divisions.x[s]) station.x = front_radius * (1 - std::cos(angle));
        const double inset = i < divisions.x[s] ? front_radius * (1 - std::sin(angle)) : 0;
        station.half_width -= inset;
        station.bottom += inset;
        station.top -= inset;
      } else if (s == 6) {
        station.top -= (station.x - breaks[6]) * slope;
      }
      stations_.push_back(station);
    }
    ends_[s] = static_cast<int>(stations_.size()) - 1;
  }
  const double block_start = 1 - 2 * block_half / (width / 2);
  for (int j = 0; j < divisions.y[0]; ++j) across_.push_back(block_start * j / divisions.y[0]);
  for (int j = 0; j <= divisions.y[1]; ++j) {
    across_.push_back(j == divisions.y[1] ? 1 : block_start + (1 - block_start) * j / divisions.y[1]);
  }
  for (int k = 0; k <= divisions.z; ++k) up_.push_back(static_cast<double>(k) / divisions.z);
}

Vec3 AhmedLattice::point(int i, int j, int k) const {
  const Station& s = stations_[i];
  return {s.x, s.half_width * across_[j], k == static_cast<int>(up_.size()) - 1 ? s.top : s.bottom + up_[k] * (s.top - s.bottom)};
}

}  // namespace deform
