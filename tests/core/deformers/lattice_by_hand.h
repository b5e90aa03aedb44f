// SPDX-License-Identifier: GPL-3.0-or-later
// Free-form deformation as it is defined: recurrences and sums that are written here.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "core/base/vectors.h"
#include "core/numerics/lattice/lattice_options.h"

namespace deform::test {

inline double binomial(std::size_t n, std::size_t i) {
  return i == 0 ? 1 : binomial(n, i - 1) * static_cast<double>(n - i + 1) / static_cast<double>(i);
}

/// De Boor's recurrence as it stands.
inline double spline(const std::vector<double>& t, std::size_t i, std::size_t degree, double u) {
  if (degree == 0) return u >= t[i] && (u < t[i + 1] || (u == 1 && t[i] < t[i + 1] && t[i + 1] == 1)) ? 1 : 0;
  double sum = 0;
  if (t[i + degree] > t[i]) sum += (u - t[i]) / (t[i + degree] - t[i]) * spline(t, i, degree - 1, u);
  if (t[i + degree + 1] > t[i + 1]) {
    sum += (t[i + degree + 1] - u) / (t[i + degree + 1] - t[i + 1]) * spline(t, i + 1, degree - 1, u);
  }
  return sum;
}

inline double spline_value(LatticeBasis basis, std::size_t points, std::size_t i, double u) {
  if (basis == LatticeBasis::bernstein) {
    return binomial(points - 1, i) * std::pow(u, static_cast<double>(i)) * std::pow(1 - u, static_cast<double>(points - 1 - i));
  }
  std::vector<double> knots;
  for (std::size_t k = 0; k < points + 4; ++k) {
    const double knot = (static_cast<double>(k) - 3) / static_cast<double>(points - 3);
    knots.push_back(basis == LatticeBasis::uniform_cubic ? knot : std::clamp(knot, 0.0, 1.0));
  }
  return spline(knots, i, 3, u);
}

/// Local coordinates by Cramer's rule.
inline Vec3 local(const LatticeFrame& frame, const Vec3& x) {
  const auto& [a, b, c] = frame.axes;
  const Vec3 r = x - frame.origin;
  const double volume = dot(a, cross(b, c));
  return {dot(r, cross(b, c)) / volume, dot(a, cross(r, c)) / volume, dot(a, cross(b, r)) / volume};
}

inline Vec3 triple_sum(const LatticeOptions& lattice, const std::vector<Vec3>& values, const Vec3& u) {
  const auto& [l, m, n] = lattice.points;
  Vec3 sum{};
  for (std::size_t k = 0; k < n; ++k) {
    for (std::size_t j = 0; j < m; ++j) {
      for (std::size_t i = 0; i < l; ++i) {
        const double weight = spline_value(lattice.basis, l, i, u[0]) * spline_value(lattice.basis, m, j, u[1]) *
                              spline_value(lattice.basis, n, k, u[2]);
        sum = sum + weight * values[i + l * (j + m * k)];
      }
    }
  }
  return sum;
}

/// Places of control points at rest: coefficients of the function u are the means of the inner knots.
inline std::vector<Vec3> rest_places(const LatticeOptions& lattice) {
  const auto abscissa = [&](std::size_t points, std::size_t i) {
    if (lattice.basis == LatticeBasis::bernstein) return static_cast<double>(i) / static_cast<double>(points - 1);
    double sum = 0;
    for (std::size_t k = i + 1; k <= i + 3; ++k) {
      const double knot = (static_cast<double>(k) - 3) / static_cast<double>(points - 3);
      sum += lattice.basis == LatticeBasis::uniform_cubic ? knot : std::clamp(knot, 0.0, 1.0);
    }
    return sum / 3;
  };
  const auto& [l, m, n] = lattice.points;
  const LatticeFrame& frame = *lattice.frame;
  std::vector<Vec3> places;
  for (std::size_t k = 0; k < n; ++k) {
    for (std::size_t j = 0; j < m; ++j) {
      for (std::size_t i = 0; i < l; ++i) {
        places.push_back(frame.origin + abscissa(l, i) * frame.axes[0] + abscissa(m, j) * frame.axes[1] +
                         abscissa(n, k) * frame.axes[2]);
      }
    }
  }
  return places;
}

}  // namespace deform::test
