// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/lattice/lattice_options.h"

#include <algorithm>
#include <cmath>

#include "core/base/error.h"
#include "core/base/vectors.h"

namespace deform {

Lattice lattice_around(const LatticeOptions& options, const Box& box) {
  LatticeFrame frame;
  if (options.frame) {
    frame = *options.frame;
  } else {
    const double padding = LatticeOptions::automatic_padding * box.diagonal();
    if (!(padding > 0)) throw Error(ErrorCode::invalid_argument, "mesh: all points coincide, so it has no extent to deform");
    for (std::size_t k = 0; k < 3; ++k) {
      frame.origin[k] = box.min[k] - padding;
      frame.axes[k] = {};
      frame.axes[k][k] = box.max[k] - box.min[k] + 2 * padding;
    }
  }
  std::array<std::size_t, 3> points = options.points;
  if (points == std::array<std::size_t, 3>{}) {
    const auto& axes = frame.axes;
    const double longest = std::max({norm(axes[0]), norm(axes[1]), norm(axes[2])});
    const bool bernstein = options.basis == LatticeBasis::bernstein;
    const double most = bernstein ? LatticeOptions::automatic_degree : LatticeOptions::automatic_cells;
    for (std::size_t k = 0; k < 3; ++k) {
      const double count = longest > 0 ? std::max(1.0, std::round(most * norm(axes[k]) / longest)) : 1;
      points[k] = static_cast<std::size_t>(count) + (bernstein ? 1 : 3);
    }
  }
  return Lattice(frame, points, options.basis);
}

}  // namespace deform
