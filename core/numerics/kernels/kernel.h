#pragma once

#include <array>
#include <cstddef>

#include "core/base/types.h"

namespace deform {

/// Radial kernels (thesis table 3.1). r is a distance, s the shape parameter.
enum class Kernel {
  triharmonic,           ///< r^3, order 2
  biharmonic,            ///< r, order 1
  quintic,               ///< r^5, order 3
  gaussian,              ///< exp(-(r/s)^2), positive definite
  multiquadric,          ///< sqrt(r^2 + s^2), order 1
  inverse_multiquadric,  ///< 1 / sqrt(r^2 + s^2), positive definite
  wendland_c2,           ///< (1 - r/s)_+^4 (4 r/s + 1), positive definite in three dimensions
  thin_plate,            ///< r^2 log r, order 2: in the plane what r^3 is in space, the interpolant of least bending
};

/// What a kernel says about the system it leads to: sign * phi is positive definite on the complement of the polynomials of total
/// degree order - 1 (Wendland, Scattered Data Approximation, chapter 8), so the polynomial part is derived and never remembered.
struct KernelProperties {
  const char* name;  ///< lower case, as in messages
  int order;         ///< of conditional positive definiteness; 0 = positive definite
  int sign;          ///< +1 or -1
  bool has_shape;
};

KernelProperties properties(Kernel kernel);

/// A shape parameter for centres that are `spacing` apart and `diagonal` across. The Gaussian and the multiquadrics are analytic:
/// their systems are numerically singular as soon as s is many spacings, so s is 2 of them for the Gaussian and 3 for the
/// multiquadrics, at most half the diagonal (conditions of 1e6 to 1e11 on surfaces). Wendland's condition grows with a power
/// only: half the diagonal.
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
  double shape = 1;  ///< s; ignored by r, r^3, r^5
  Parity parity{};
};

/// phi at squared distance r2, without the images. The reference that the vectorized sums are tested against.
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
