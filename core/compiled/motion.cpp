// SPDX-License-Identifier: Apache-2.0
#include "core/compiled/motion.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdio>

#include "core/base/number_text.h"
#include "core/base/vectors.h"

namespace deform::compiled {

namespace {

using Linear = std::array<double, 9>;

bool is_zero(const Vec3& v) { return v[0] == 0 && v[1] == 0 && v[2] == 0; }
Vec3 normalized(const Vec3& v) { return v / norm(v); }

Affine translation(const Vec3& d, double v) { return {1, 0, 0, v * d[0], 0, 1, 0, v * d[1], 0, 0, 1, v * d[2]}; }

// A and b = c - A c for the linear map A about the centre c.
Affine about(const Linear& A, const Vec3& c, double keep) {
  Affine m{};
  for (int i = 0; i < 3; ++i) {
    double moved = 0;
    for (int j = 0; j < 3; ++j) {
      m[4 * i + j] = A[3 * i + j];
      moved += A[3 * i + j] * c[j];
    }
    m[4 * i + 3] = keep * c[i] - moved;
  }
  return m;
}

// Rodrigues: cos I + sin [a]x + (1 - cos) a a^T, with the factors given, so that the derivative is the same expression.
Linear rodrigues(const Vec3& a, double identity, double cross, double outer) {
  return {identity + outer * a[0] * a[0],     outer * a[0] * a[1] - cross * a[2], outer * a[0] * a[2] + cross * a[1],
          outer * a[1] * a[0] + cross * a[2], identity + outer * a[1] * a[1],     outer * a[1] * a[2] - cross * a[0],
          outer * a[2] * a[0] - cross * a[1], outer * a[2] * a[1] + cross * a[0], identity + outer * a[2] * a[2]};
}

Linear scaling(const Vec3& axis, double identity, double v) {
  if (is_zero(axis)) return {identity + v, 0, 0, 0, identity + v, 0, 0, 0, identity + v};
  return rodrigues(normalized(axis), identity, 0, v);
}

/// The cross products of the rows of the linear part: its cofactors, row by row.
std::array<Vec3, 3> cofactors(const std::array<Vec3, 3>& rows) {
  return {cross(rows[1], rows[2]), cross(rows[2], rows[0]), cross(rows[0], rows[1])};
}

std::array<Vec3, 3> rows_of(const Affine& m) { return {{{m[0], m[1], m[2]}, {m[4], m[5], m[6]}, {m[8], m[9], m[10]}}}; }

double norm_of(const std::array<Vec3, 3>& rows) { return norm(Vec3{norm(rows[0]), norm(rows[1]), norm(rows[2])}); }

}  // namespace

Affine motion_at(const VariableMotion& motion, double v) {
  if (v == 0) return identity_affine;  // exactly at rest, whatever the centre
  switch (motion.kind) {
    case MotionKind::translation:
      break;
    case MotionKind::rotation: {
      const double angle = v * motion.unit;
      return about(rodrigues(normalized(motion.vector), std::cos(angle), std::sin(angle), 1 - std::cos(angle)), motion.centre, 1);
    }
    case MotionKind::scaling:
      return about(scaling(motion.vector, 1, v), motion.centre, 1);
  }
  return translation(motion.vector, v);
}

Affine motion_rate(const VariableMotion& motion, double v) {
  switch (motion.kind) {
    case MotionKind::translation:
      break;
    case MotionKind::rotation: {
      const double angle = v * motion.unit, rate = motion.unit * std::sin(angle);
      return about(rodrigues(normalized(motion.vector), -rate, motion.unit * std::cos(angle), rate), motion.centre, 0);
    }
    case MotionKind::scaling:
      return about(scaling(motion.vector, 0, 1), motion.centre, 0);
  }
  return {0, 0, 0, motion.vector[0], 0, 0, 0, motion.vector[1], 0, 0, 0, motion.vector[2]};
}

std::string unusable_value(const VariableMotion& motion, double v) {
  constexpr double largest_angle = 1e12;  // radians: doubles beyond are more than 1e-4 apart
  if (motion.kind != MotionKind::rotation || std::abs(v * motion.unit) <= largest_angle) return {};
  return "turns by more than 1e12 radians, where the rounding of the number is an angle itself";
}

Shape shape_under(const Affine& motion) {
  constexpr double flat = 1e-6;
  std::array<Vec3, 3> rows = rows_of(motion);
  double largest = 0;
  for (const Vec3& row : rows) largest = std::max({largest, std::abs(row[0]), std::abs(row[1]), std::abs(row[2])});
  if (largest == 0) return Shape::flattened;
  for (Vec3& row : rows) row = row / largest;  // so that no product overflows
  const std::array<Vec3, 3> minors = cofactors(rows);
  const double determinant = dot(rows[0], minors[0]);
  if (std::abs(determinant) <= flat * norm_of(rows) * norm_of(minors)) return Shape::flattened;
  return determinant < 0 ? Shape::mirrored : Shape::kept;
}

std::string shape_doubt(const std::string& handle, const Affine& motion, std::span<const Scale> scales) {
  const Shape shape = shape_under(motion);
  if (shape == Shape::kept) return {};
  std::string by;
  for (const Scale& scale : scales) {
    by += (by.empty() ? " by " : ", ") + scale.variable + " = " + number_digits(scale.value);
  }
  const std::array<Vec3, 3> rows = rows_of(motion);
  char determinant[32];
  std::snprintf(determinant, sizeof determinant, "%.3g", dot(rows[0], cofactors(rows)[0]));
  return "handle \"" + handle + "\" is " + (shape == Shape::flattened ? "flattened" : "mirrored") + by +
         ": its linear map has determinant " + determinant;
}

std::vector<std::string> first_doubts(std::vector<std::string> doubts) {
  constexpr std::size_t most = 3;
  if (doubts.size() <= most) return doubts;
  const std::size_t more = doubts.size() - most;
  doubts.resize(most);
  doubts.push_back(std::to_string(more) + (more == 1 ? " handle more is" : " handles more are") + " mirrored or flattened");
  return doubts;
}

Affine chained(const Affine& outer, const Affine& inner, double inner_weight) {
  Affine c{};
  for (int row = 0; row < 3; ++row) {
    for (int col = 0; col < 4; ++col) {
      double sum = col == 3 ? inner_weight * outer[4 * row + 3] : 0.0;
      for (int k = 0; k < 3; ++k) sum += outer[4 * row + k] * inner[4 * k + col];
      c[4 * row + col] = sum;
    }
  }
  return c;
}

double largest_terms(const Affine& motion, double coordinate) {
  Vec3 terms{};
  for (std::size_t i = 0; i < 3; ++i) {
    terms[i] = std::abs(motion[4 * i + 3]);
    for (std::size_t j = 0; j < 3; ++j) terms[i] += std::abs(motion[4 * i + j]) * coordinate;
  }
  return norm(terms);
}

void field_coefficients(const Affine& motion, double identity, const FieldFrame& frame, double* out) {
  // u(x) = J x + b with J = A - I for a map of positions; about the reference c: u = (J c + b) + scale J (unit(x) - unit(c)).
  Vec3 c{};
  for (int k = 0; k < 3; ++k) c[k] = frame.origin[k] + frame.scale * frame.reference[k];
  for (int i = 0; i < 3; ++i) {
    double constant = motion[4 * i + 3];
    Vec3 slope;
    for (int j = 0; j < 3; ++j) {
      slope[j] = motion[4 * i + j] - (i == j ? identity : 0.0);
      constant += slope[j] * c[j];
    }
    out[i] = constant;
    for (int j = 0; j < 3; ++j) out[3 * (j + 1) + i] = frame.scale * dot(slope, frame.axes[j]);
  }
}

}  // namespace deform::compiled
