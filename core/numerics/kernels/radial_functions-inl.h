// SPDX-License-Identifier: GPL-3.0-or-later
// The radial kernels: each is one struct with its properties and its evaluation in any number type. Included once per
// instruction set by what includes hwy/foreach_target.h, so without #pragma once.
#if defined(DEFORM_RADIAL_FUNCTIONS_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef DEFORM_RADIAL_FUNCTIONS_INL_H
#undef DEFORM_RADIAL_FUNCTIONS_INL_H
#else
#define DEFORM_RADIAL_FUNCTIONS_INL_H
#endif

#include <hwy/highway.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "core/numerics/kernels/kernel.h"

HWY_BEFORE_NAMESPACE();
namespace deform::HWY_NAMESPACE {

// A number type T needs +, - and * (also with a double) and these functions. These are the ones of double.
using std::exp;
using std::sqrt;
HWY_INLINE double positive_part(double x) { return std::max(0.0, x); }
HWY_INLINE double reciprocal(double x) { return 1 / x; }
HWY_INLINE double multiply_add(double a, double x, double b) { return a * x + b; }
HWY_INLINE double finite_log(double x) { return std::log(std::max(x, 1e-300)); }  // finite at 0

// A kernel has `properties`, a constructor from the shape parameter s, and an operator that evaluates phi at a squared
// distance r2 of type T. To add one, write its struct, append it to AllKernels and append its name to the enum of kernel.h,
// in the same order.

/// r^3
struct Triharmonic {
  static constexpr KernelProperties properties{
      .kernel = Kernel::triharmonic, .name = "triharmonic", .order = 2, .sign = 1, .overshoots = true};
  explicit Triharmonic(double) {}
  template <typename T>
  HWY_INLINE T operator()(T r2) const {
    return r2 * sqrt(r2);
  }
};

/// r
struct Biharmonic {
  static constexpr KernelProperties properties{.kernel = Kernel::biharmonic,
                                               .name = "biharmonic",
                                               .order = 1,
                                               .sign = -1,
                                               .overshoots = false,
                                               .reduction_tolerance = 1e-3};
  explicit Biharmonic(double) {}
  template <typename T>
  HWY_INLINE T operator()(T r2) const {
    return sqrt(r2);
  }
};

/// r^5
struct Quintic {
  static constexpr KernelProperties properties{
      .kernel = Kernel::quintic, .name = "quintic", .order = 3, .sign = -1, .overshoots = true};
  explicit Quintic(double) {}
  template <typename T>
  HWY_INLINE T operator()(T r2) const {
    return r2 * r2 * sqrt(r2);
  }
};

/// exp(-(r/s)^2), which is 1e-4 at r = 3 s
struct Gaussian {
  static constexpr KernelProperties properties{.kernel = Kernel::gaussian,
                                               .name = "gaussian",
                                               .order = 0,
                                               .sign = 1,
                                               .overshoots = false,
                                               .has_shape = true,
                                               .spacings = 2,
                                               .local_shape = 1.0 / 3,
                                               .falls_off = true};
  explicit Gaussian(double s) : minus_inverse_s2(-1 / (s * s)) {}
  template <typename T>
  HWY_INLINE T operator()(T r2) const {
    return exp(r2 * minus_inverse_s2);
  }
  double minus_inverse_s2;
};

/// sqrt(r^2 + s^2)
struct Multiquadric {
  static constexpr KernelProperties properties{.kernel = Kernel::multiquadric,
                                               .name = "multiquadric",
                                               .order = 1,
                                               .sign = -1,
                                               .overshoots = false,
                                               .has_shape = true,
                                               .spacings = 3};
  explicit Multiquadric(double s) : s2(s * s) {}
  template <typename T>
  HWY_INLINE T operator()(T r2) const {
    return sqrt(r2 + s2);
  }
  double s2;
};

/// 1 / sqrt(r^2 + s^2)
struct InverseMultiquadric {
  static constexpr KernelProperties properties{.kernel = Kernel::inverse_multiquadric,
                                               .name = "inverse_multiquadric",
                                               .order = 0,
                                               .sign = 1,
                                               .overshoots = false,
                                               .has_shape = true,
                                               .spacings = 3,
                                               .falls_off = true};
  explicit InverseMultiquadric(double s) : s2(s * s) {}
  template <typename T>
  HWY_INLINE T operator()(T r2) const {
    return reciprocal(sqrt(r2 + s2));
  }
  double s2;
};

/// (1 - r/s)_+^4 (4 r/s + 1), positive definite in three dimensions. The condition number grows only like a power of s, so the
/// spacing sets no limit.
struct WendlandC2 {
  static constexpr KernelProperties properties{.kernel = Kernel::wendland_c2,
                                               .name = "wendland_c2",
                                               .order = 0,
                                               .sign = 1,
                                               .overshoots = true,
                                               .has_shape = true,
                                               .smooth = false,
                                               .spacings = std::numeric_limits<double>::infinity(),
                                               .local_shape = 1};
  explicit WendlandC2(double s) : inverse_s(1 / s) {}
  template <typename T>
  HWY_INLINE T operator()(T r2) const {
    const T q = sqrt(r2) * inverse_s;
    const T t = positive_part(1.0 - q);
    const T t2 = t * t;
    return t2 * t2 * multiply_add(4.0, q, 1.0);
  }
  double inverse_s;
};

/// r^2 log r, the interpolant of least bending energy in the plane, as r^3 is in space
struct ThinPlate {
  static constexpr KernelProperties properties{
      .kernel = Kernel::thin_plate, .name = "thin_plate", .order = 2, .sign = 1, .overshoots = true};
  explicit ThinPlate(double) {}
  template <typename T>
  HWY_INLINE T operator()(T r2) const {
    return r2 * 0.5 * finite_log(r2);
  }
};

template <typename... Kernels>
struct KernelList {
  static constexpr std::array<KernelProperties, sizeof...(Kernels)> properties{Kernels::properties...};

  /// Calls body(phi) with the struct of the kernel.
  template <typename Body>
  static HWY_INLINE void visit(const RadialKernel& kernel, const Body& body) {
    (void)((kernel.kernel == Kernels::properties.kernel && (body(Kernels(kernel.shape)), true)) || ...);
  }
};

using AllKernels =
    KernelList<Triharmonic, Biharmonic, Quintic, Gaussian, Multiquadric, InverseMultiquadric, WendlandC2, ThinPlate>;

}  // namespace deform::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
