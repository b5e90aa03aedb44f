// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/projection.h"

#include <algorithm>
#include <cmath>

#include "core/base/vectors.h"

namespace deform {

Projection::Misfit Projection::misfit(std::span<const Vec3> x, std::span<const Vec3> y) const {
  Misfit misfit;
  misfit.count = x.size();
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double square = squared_distance(x[i], y[i]);
    misfit.squares += square;
    misfit.largest = std::max(misfit.largest, std::sqrt(square));
  }
  return misfit;
}

}  // namespace deform
