// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "core/base/types.h"
#include "core/numerics/kernels/kernel.h"

namespace deform::test {

/// Evenly distributed in the unit box, the same for the same seed.
inline std::vector<Vec3> random_points(std::size_t count, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  std::vector<Vec3> points(count);
  for (Vec3& p : points) p = {uniform(random), uniform(random), uniform(random)};
  return points;
}

inline std::vector<double> random_values(std::size_t count, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<double> values(count);
  for (double& v : values) v = uniform(random);
  return values;
}

/// Every kernel, with a shape parameter that suits a few hundred points in the unit box.
inline std::vector<RadialKernel> all_kernels() {
  return {{Kernel::triharmonic, 1},   {Kernel::biharmonic, 1},     {Kernel::quintic, 1},
          {Kernel::gaussian, 0.15},   {Kernel::multiquadric, 0.1}, {Kernel::inverse_multiquadric, 0.1},
          {Kernel::wendland_c2, 0.8}, {Kernel::thin_plate, 1}};
}

inline double squared_distance(const Vec3& a, const Vec3& b) {
  double sum = 0;
  for (std::size_t k = 0; k < 3; ++k) sum += (a[k] - b[k]) * (a[k] - b[k]);
  return sum;
}

}  // namespace deform::test
