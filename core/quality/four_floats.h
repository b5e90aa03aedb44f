// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstring>

namespace deform::quality {

/// Three coordinates and an unused fourth number in one SIMD register, by the vector extension of GCC and Clang.
struct FourFloats {
  using Lanes = float __attribute__((vector_size(16)));
  Lanes lanes{};

  FourFloats() = default;
  FourFloats(Lanes l) : lanes(l) {}  // NOLINT: implicit
  FourFloats(float x, float y, float z) : lanes{x, y, z, 0} {}
  static FourFloats all(float x) { return Lanes{x, x, x, x}; }
  static FourFloats load(const float* four) {
    Lanes l;
    std::memcpy(&l, four, sizeof l);
    return l;
  }
  float operator[](std::size_t i) const { return lanes[i]; }
  /// The largest of the three.
  float largest() const { return std::max({lanes[0], lanes[1], lanes[2]}); }
};

inline FourFloats operator+(const FourFloats& a, const FourFloats& b) { return a.lanes + b.lanes; }
inline FourFloats operator-(const FourFloats& a, const FourFloats& b) { return a.lanes - b.lanes; }
inline FourFloats operator*(float a, const FourFloats& b) { return FourFloats::all(a).lanes * b.lanes; }
/// Componentwise minimum and maximum; b where either is NaN.
inline FourFloats least(const FourFloats& a, const FourFloats& b) { return a.lanes < b.lanes ? a.lanes : b.lanes; }
inline FourFloats greatest(const FourFloats& a, const FourFloats& b) { return a.lanes > b.lanes ? a.lanes : b.lanes; }
inline FourFloats magnitude(const FourFloats& a) { return greatest(a, -a.lanes); }

}  // namespace deform::quality
