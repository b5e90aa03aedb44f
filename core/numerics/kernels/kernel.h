// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <string_view>

#include "core/base/types.h"

namespace deform {

/// Radial kernels (thesis table 3.1). What each is stands in radial_functions-inl.h.
enum class Kernel {
  triharmonic,
  biharmonic,
  quintic,
  gaussian,
  multiquadric,
  inverse_multiquadric,
  wendland_c2,
  thin_plate,
};

/// What a kernel says about the system it leads to: sign * phi is positive definite on the complement of the polynomials of total
/// degree order - 1 (Wendland, Scattered Data Approximation, chapter 8), so the polynomial part is derived and never remembered.
struct KernelProperties {
  Kernel kernel;
  const char* name;        ///< lower case, as in messages
  int order;               ///< of conditional positive definiteness; 0 = positive definite
  int sign;                ///< +1 or -1
  bool has_shape = false;  ///< whether it depends on s
  bool smooth = true;      ///< everywhere but at its centre, as fast sums and the iterative solver need it
  double spacings = 0;     ///< see automatic_shape()
  /// s of a function that is cut off at distance 1, where it is next to nothing (thesis 8.3.2); 0: it does not decay.
  double local_shape = 0;

  /// Of the polynomial part, unless another one is asked for.
  int default_degree() const { return order > 2 ? order - 1 : 1; }
};

/// Every kernel, in the order of the enum.
std::span<const KernelProperties> all_kernels();
KernelProperties properties(Kernel kernel);
/// None for a name that is not that of a kernel.
std::optional<Kernel> kernel_named(std::string_view name);

/// Of a deformation that names no kernel, from the box of its points: r^2 log r in a plane z = constant, else r^3, the least
/// bending in two and in three dimensions (thesis 3.5).
Kernel default_kernel(const Box& box);

/// A shape parameter for centres that are `spacing` apart and `diagonal` across: `spacings` times the spacing, at most half the
/// diagonal. The Gaussian and the multiquadrics are analytic: their systems are numerically singular as soon as s is many
/// spacings (conditions of 1e6 to 1e11 on surfaces with 2 and 3). 1 for kernels without a shape.
double automatic_shape(Kernel kernel, double spacing, double diagonal);

/// How functions behave under the reflections x_k -> -x_k of the coordinates they are evaluated in.
struct Parity {
  std::array<int, 3> sign{};  ///< per coordinate: 0 no reflection, +1 even, -1 odd; at most one odd
  bool none() const { return sign == std::array<int, 3>{}; }
};

/// A kernel with its parameter, in the coordinates it is evaluated in. With a parity its value for a point x and a centre c is
/// the sum over the group of the reflections g of chi(g) phi(|x - g c|), where chi(g) = -1 for each odd coordinate that g
/// reflects: a function of x and of c with that parity, symmetric in both. A centre on a plane of reflection is its own image and
/// counts twice (its weight is half as large); an odd kernel is zero there.
struct RadialKernel {
  Kernel kernel = Kernel::triharmonic;
  double shape = 1;  ///< s
  Parity parity{};
};

/// phi at squared distance r2, without the images.
double value(const RadialKernel& kernel, double r2);
/// With the images.
double value(const RadialKernel& kernel, const Vec3& x, const Vec3& c);

/// The group of reflections of a parity: every image of a centre c is (flip[k] * c[k]), of weight `sign`. The odd coordinate is
/// reflected first, so that on its plane the sum over the images in order is exactly zero.
struct Images {
  struct Image {
    Vec3 flip{1, 1, 1};
    double sign = 1;
    Vec3 of(const Vec3& c) const { return {flip[0] * c[0], flip[1] * c[1], flip[2] * c[2]}; }
  };
  std::size_t count = 1;
  std::array<Image, 8> at{};
  explicit Images(const Parity& parity);
};

}  // namespace deform
