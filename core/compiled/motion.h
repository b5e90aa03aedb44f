// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "core/base/types.h"

namespace deform::compiled {

/// How a design variable moves its handle.
enum class MotionKind : std::uint32_t {
  translation = 0,  ///< x' = x + v vector
  rotation = 1,     ///< by the angle v about the axis `vector` through the centre, right-handed
  scaling = 2,      ///< x' = centre + (1 + v)(x - centre); with a vector that is not zero only along it
};

/// One of them, with its parameters: model units.
struct VariableMotion {
  MotionKind kind = MotionKind::translation;  ///< how
  Vec3 vector{};                              ///< direction or axis; need not be of unit length
  Vec3 centre{};                              ///< of rotations and scalings: what stays where it is
  double unit = 1;                            ///< of rotations: radians per unit of v; else 1
};

/// The map of positions at the value v; the identity exactly at 0.
Affine motion_at(const VariableMotion& motion, double v);
/// Its derivative with respect to v: maps positions at rest to rates.
Affine motion_rate(const VariableMotion& motion, double v);

/// Why a value cannot be distinguished from its neighbours, as the end of a sentence: a rotation by more than 1e12 radians, which
/// a double rounds by more than 1e-4. Empty for all others.
std::string unusable_value(const VariableMotion& motion, double v);

/// What a map of positions makes of a body. It is flattened if the least singular value of the linear part is below about 1e-6 of
/// the largest: |det A| <= 1e-6 |A| |cof A| in Frobenius norms. Else it is mirrored, inside out, if the determinant is negative.
enum class Shape { kept, flattened, mirrored };
Shape shape_under(const Affine& motion);

/// A scaling that takes part in the motion of a handle.
struct Scale {
  std::string variable;  ///< its name
  double value = 0;      ///< of the variable
};
/// Says that a handle is flattened or mirrored: "handle "root" is mirrored by fat = -2: its linear map has determinant -1". Empty
/// where its shape is kept. `scales`: those that are not at rest, in their order; may be empty.
std::string shape_doubt(const std::string& handle, const Affine& motion, std::span<const Scale> scales);
/// The first three of such sentences, and how many more there are.
std::vector<std::string> first_doubts(std::vector<std::string> doubts);

/// The largest sum of the magnitudes of the terms that make up a position, if no coordinate is larger than `coordinate`: rounding
/// is a fraction of it.
double largest_terms(const Affine& motion, double coordinate);

/// compose() for a derivative on either side: the translation of the inner map is carried by the linear part of the outer one,
/// and the outer translation counts only where the inner map is a map (weight 1) and no derivative (weight 0).
Affine chained(const Affine& outer, const Affine& inner, double inner_weight);

/// What the fields 1, x, y, z of a handle are measured in (thesis 4.2): x = origin + scale * unit, from a point of reference and
/// along three axes.
struct FieldFrame {
  Vec3 origin{};                                                ///< model units
  double scale = 1;                                             ///< model units
  Vec3 reference{};                                             ///< unit coordinates
  std::array<Vec3, 3> axes{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};  ///< orthonormal
};

/// The displacement field of an affine motion on a handle as the coefficients of its four fields, 4 x 3 row by row, model units.
/// `motion` maps positions to positions (identity 1: the displacement is motion(x) - x) or to displacements (identity 0).
void field_coefficients(const Affine& motion, double identity, const FieldFrame& frame, double* out);

}  // namespace deform::compiled
