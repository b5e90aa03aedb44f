// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <string_view>

#include "core/base/types.h"

namespace deform {

/// Radial kernels (thesis table 3.1), defined in radial_functions-inl.h.
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

/// The properties of a kernel. sign * phi is conditionally positive definite of this order, that is positive definite on the
/// complement of the polynomials of total degree order - 1 (Wendland, Scattered Data Approximation, chapter 8). The least degree
/// of the polynomial part follows from it.
struct KernelProperties {
  Kernel kernel;
  const char* name;  ///< lower case, as shown in messages
  int order;         ///< order of conditional positive definiteness; 0 = positive definite
  int sign;          ///< +1 or -1
  /// Whether it carries the slopes of handles that turn or bend on beyond them, since it is smooth at its centre and does not
  /// decay within a few spacings: points between handles may move farther than these.
  bool overshoots;
  bool has_shape = false;  ///< whether it has a shape parameter s
  bool smooth = true;      ///< away from its centre, as fast sums and the iterative solver require
  double spacings = 0;     ///< see automatic_shape()
  /// The s at which the kernel is negligible beyond distance 1, where it is cut off (thesis 8.3.2); 0 if it does not decay.
  double local_shape = 0;
  /// Whether it falls off from its centre over about s: weights are of the size of the values, slopes of these over s, and the
  /// rounding of coordinates counts.
  bool falls_off = false;
  /// The misfit of affine motions at constraint points that are not centres, as a fraction of the largest displacement, by which
  /// the deformable region changed by less than 1e-2 of it in measurements. There such misfits are amplified up to sixty times
  /// with r^3, and divided by three with r.
  double reduction_tolerance = 1e-4;

  /// Default degree of the polynomial part.
  int default_degree() const { return order > 2 ? order - 1 : 1; }
};

/// All kernels, in the order of the enum.
std::span<const KernelProperties> all_kernels();
KernelProperties properties(Kernel kernel);
/// The kernel with this name, or std::nullopt.
std::optional<Kernel> kernel_named(std::string_view name);

/// The default kernel of a deformation, from the bounding box of its points: r^2 log r in a plane z = constant, to 1e-9 D, else
/// r^3. They minimize the bending energy in two and three dimensions (thesis 3.5).
Kernel default_kernel(const Box& box);

/// The default shape parameter for centres with this typical spacing and this diagonal of their bounding box: `spacings` times
/// the spacing, but at most half the diagonal. The Gaussian and the multiquadrics are analytic, so their systems become
/// numerically singular if s is many spacings (condition numbers of 1e6 to 1e11 on surfaces for 2 and 3 spacings). Returns 1 for
/// kernels without a shape.
double automatic_shape(Kernel kernel, double spacing, double diagonal);

/// The parity of functions under the reflections x_k -> -x_k of the coordinates in which they are evaluated.
struct Parity {
  std::array<int, 3> sign{};  ///< for each coordinate 0 (no reflection), +1 (even) or -1 (odd); at most one is odd
  bool none() const { return sign == std::array<int, 3>{}; }
};

/// A kernel with its shape parameter, in the coordinates in which it is evaluated. With a parity its value for a point x and a
/// centre c is the sum over the group of the reflections g of chi(g) phi(|x - g c|), where chi(g) = -1 for each odd coordinate
/// that g reflects: a function of x and of c with that parity, symmetric in both. A centre on a plane of reflection is its own
/// image and counts twice (so its weight is halved); an odd kernel is zero there.
struct RadialKernel {
  Kernel kernel = Kernel::triharmonic;
  double shape = 1;  ///< s
  Parity parity{};
};

/// phi at squared distance r2, without the images.
double value(const RadialKernel& kernel, double r2);
/// The sum over the images for a point x and a centre c.
double value(const RadialKernel& kernel, const Vec3& x, const Vec3& c);

/// The group of reflections of a parity. Each image of a centre c is (flip[k] * c[k]) with the weight `sign`. The odd coordinate
/// is reflected first, so that the sum over the images in this order is exactly zero on its plane.
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
