// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/kernels/kernel.h"

#include <algorithm>

#include "core/numerics/kernels/radial_functions-inl.h"

namespace deform {

namespace {

using HWY_NAMESPACE::AllKernels;

constexpr bool in_order_of_the_enum() {
  for (std::size_t i = 0; i < AllKernels::properties.size(); ++i) {
    if (static_cast<std::size_t>(AllKernels::properties[i].kernel) != i) return false;
  }
  return true;
}
static_assert(in_order_of_the_enum());

}  // namespace

std::span<const KernelProperties> all_kernels() { return AllKernels::properties; }

KernelProperties properties(Kernel kernel) { return AllKernels::properties.at(static_cast<std::size_t>(kernel)); }

std::optional<Kernel> kernel_named(std::string_view name) {
  for (const KernelProperties& kernel : all_kernels()) {
    if (kernel.name == name) return kernel.kernel;
  }
  return std::nullopt;
}

Kernel default_kernel(const Box& box) {
  constexpr double rounding = 1e-9;  // of D, as for meshes that count as 2D in checks
  return box.side(2) <= rounding * box.diagonal() ? Kernel::thin_plate : Kernel::triharmonic;
}

double automatic_shape(Kernel kernel, double spacing, double diagonal) {
  const KernelProperties known = properties(kernel);
  return known.has_shape ? std::min(0.5 * diagonal, known.spacings * spacing) : 1;
}

double value(const RadialKernel& kernel, double r2) {
  double result = 0;
  AllKernels::visit(kernel, [&](const auto& phi) { result = phi(r2); });
  return result;
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
