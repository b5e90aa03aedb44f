// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "core/base/types.h"

namespace deform {

/// How finely each part of the Ahmed body is divided. The half with y >= 0 is built and mirrored.
struct AhmedDivisions {
  std::array<int, 7> x{};  ///< rounded front, then flat: to stilt, stilt, between, stilt, to slant, slant
  std::array<int, 2> y{};  ///< symmetry plane to stilt block, stilt block (as many as each stilt segment of x)
  int z = 0;
  int ring = 0;   ///< rows from the circle of a stilt to its square block
  int stilt = 0;  ///< rows from the underbody to the ground
  int disc = 0;   ///< rows from the circle at the ground to the square inside

  /// Divisions for edges of length `spacing` (approximately), in metres.
  static AhmedDivisions for_spacing(double spacing, double slant_degrees);
  int x_count() const;
  int y_count() const { return y[0] + y[1]; }
  int block() const { return y[1]; }
  /// The number of points of the whole body.
  std::size_t point_count() const;
};

/// A hexahedral lattice whose surface is the body without its stilts: station i = 0..x_count() in x from the nose to the base, j
/// = 0..y_count() from the symmetry plane to the side, k = 0..z from the underbody to the roof.
class AhmedLattice {
 public:
  AhmedLattice(const AhmedDivisions& divisions, double slant_degrees);

  Vec3 point(int i, int j, int k) const;
  /// The first station behind a segment of AhmedDivisions::x.
  int station_after(int segment) const { return ends_[segment]; }

 private:
  struct Station {
    double x, half_width, bottom, top;
  };
  std::vector<Station> stations_;
  std::vector<double> across_;  // y / half width, 0..1
  std::vector<double> up_;      // 0..1 from bottom to top
  std::array<int, 7> ends_{};
};

/// Dimensions of the body in metres (SAE 840300).
namespace ahmed {
inline constexpr double length = 1.044, width = 0.389, height = 0.288, clearance = 0.050;
inline constexpr double front_radius = 0.100, slant_length = 0.222;
inline constexpr double stilt_radius = 0.015, stilt_y = 0.1635;
inline constexpr std::array<double, 2> stilt_x{0.202, 0.672};
/// Half the side of the square block of the underbody around each stilt; it reaches to the side edge.
inline constexpr double block_half = width / 2 - stilt_y;
}  // namespace ahmed

}  // namespace deform
