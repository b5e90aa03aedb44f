#pragma once

#include <random>

#include "core/base/types.h"
#include "core/numerics/kernel.h"

namespace deform::test {

inline Points random_points(std::size_t count, unsigned seed = 1) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> uniform(0, 1);
  Points points(count);
  for (Vec3& p : points) p = {uniform(random), uniform(random), uniform(random)};
  return points;
}

inline double distance2(const Vec3& a, const Vec3& b) {
  const double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
  return x * x + y * y + z * z;
}

/// Every kernel, with a shape that leaves a few hundred points of the unit box well conditioned.
inline std::vector<RadialKernel> all_kernels() {
  return {{Kernel::triharmonic, 1},  {Kernel::biharmonic, 1},     {Kernel::quintic, 1},
          {Kernel::gaussian, 0.1},   {Kernel::multiquadric, 0.1}, {Kernel::inverse_multiquadric, 0.1},
          {Kernel::wendland_c2, 0.5}};
}

}  // namespace deform::test
