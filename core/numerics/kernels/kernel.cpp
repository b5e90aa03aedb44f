#include "core/numerics/kernels/kernel.h"

#include <algorithm>
#include <cmath>

namespace deform {

KernelProperties properties(Kernel kernel) {
  switch (kernel) {
    case Kernel::triharmonic:
      return {"triharmonic", 2, 1, false};
    case Kernel::biharmonic:
      return {"biharmonic", 1, -1, false};
    case Kernel::quintic:
      return {"quintic", 3, -1, false};
    case Kernel::gaussian:
      return {"gaussian", 0, 1, true};
    case Kernel::multiquadric:
      return {"multiquadric", 1, -1, true};
    case Kernel::inverse_multiquadric:
      return {"inverse_multiquadric", 0, 1, true};
    case Kernel::wendland_c2:
      return {"wendland_c2", 0, 1, true};
    case Kernel::thin_plate:
      return {"thin_plate", 2, 1, false};
  }
  return {"triharmonic", 2, 1, false};
}

double automatic_shape(Kernel kernel, double spacing, double diagonal) {
  const double largest = 0.5 * diagonal;
  if (kernel == Kernel::wendland_c2) return largest;
  return std::min(largest, (kernel == Kernel::gaussian ? 2 : 3) * spacing);
}

double value(const RadialKernel& kernel, double r2) {
  const double r = std::sqrt(r2);
  const double s = kernel.shape;
  switch (kernel.kernel) {
    case Kernel::triharmonic:
      return r2 * r;
    case Kernel::biharmonic:
      return r;
    case Kernel::quintic:
      return r2 * r2 * r;
    case Kernel::gaussian:
      return std::exp(-r2 / (s * s));
    case Kernel::multiquadric:
      return std::sqrt(r2 + s * s);
    case Kernel::inverse_multiquadric:
      return 1 / std::sqrt(r2 + s * s);
    case Kernel::wendland_c2: {
      const double t = std::max(0.0, 1 - r / s);
      return t * t * t * t * (4 * r / s + 1);
    }
    case Kernel::thin_plate:
      return r2 > 0 ? 0.5 * r2 * std::log(r2) : 0;
  }
  return 0;
}

double value(const RadialKernel& kernel, const Vec3& x, const Vec3& c) {
  const auto one = [&](const Vec3& centre) {
    const double dx = x[0] - centre[0], dy = x[1] - centre[1], dz = x[2] - centre[2];
    return value(kernel, dx * dx + dy * dy + dz * dz);
  };
  if (kernel.parity.none()) return one(c);
  const Images images(kernel.parity);
  double sum = 0;
  for (std::size_t g = 0; g < images.count; ++g) sum += images.at[g].sign * one(images.at[g].of(c));
  return sum;
}

Images::Images(const Parity& parity) {
  const auto reflect = [&](std::size_t k) {
    for (std::size_t g = 0; g < count; ++g) {
      Image image = at[g];
      image.flip[k] = -1;
      image.sign *= parity.sign[k];
      at[count + g] = image;
    }
    count *= 2;
  };
  for (std::size_t k = 0; k < 3; ++k) {
    if (parity.sign[k] < 0) reflect(k);
  }
  for (std::size_t k = 0; k < 3; ++k) {
    if (parity.sign[k] > 0) reflect(k);
  }
}

}  // namespace deform
