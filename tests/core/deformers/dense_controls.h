// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/deformers/setup.h"

/// Functions of control points by their published formulas, and direct manipulation by them, in extended precision.
namespace deform::test::dense_controls {

using Extended = long double;
using Matrix = Eigen::Matrix<Extended, Eigen::Dynamic, Eigen::Dynamic>;
using Place = std::array<Extended, 3>;

/// Control points with their functions.
class Functions {
 public:
  virtual ~Functions() = default;
  /// The value of every function at a place; empty where all are zero.
  virtual std::vector<Extended> values(const Vec3& x) const = 0;
};

/// A lattice whose frame and numbers of points are given.
class LatticeFunctions : public Functions {
 public:
  explicit LatticeFunctions(const LatticeOptions& options);

  std::size_t size() const { return options_.points[0] * options_.points[1] * options_.points[2]; }

  /// Where a control point is at rest.
  Place rest(std::size_t number) const;

  std::vector<Extended> values(const Vec3& x) const override;

 private:
  /// Cox and de Boor's recurrence.
  std::vector<Extended> splines(std::size_t k, Extended u) const;

  const LatticeOptions options_;
  std::array<std::size_t, 3> degrees_{};
  std::array<std::vector<Extended>, 3> knots_;
  Eigen::Matrix<Extended, 3, 3> inverse_;
};

/// Mean value coordinates by spherical triangles (Ju, Schaefer, Warren 2005, figure 4), for places off the planes of the
/// triangles.
class CageFunctions : public Functions {
 public:
  explicit CageFunctions(const CageOptions& options) : options_(options) {}

  std::vector<Extended> values(const Vec3& x) const override;

 private:
  static Extended length(const Place& a) { return std::sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]); }

  static void add(const std::array<std::uint32_t, 3>& triangle, const std::vector<Place>& units,
                  const std::vector<Extended>& distances, std::vector<Extended>& weights);

  const CageOptions options_;
};

/// Green coordinates (Lipman, Levin, Cohen-Or 2008) as layer potentials of the triangles: solid angles (Van Oosterom and Strackee
/// 1983) and logarithms of the sides (Wilton et al. 1984), for places inside and off the planes of the triangles.
class GreenOracle {
 public:
  explicit GreenOracle(const CageOptions& options) : options_(options) {}

  /// The displacement of a place, from those of the vertices.
  Place displacement(const Vec3& x, const Matrix& moved) const;

 private:
  const CageOptions options_;
};

/// The coefficients w of least |A w - h|^2 + (damping s)^2 |w|^2 with the largest singular value s of A, whose rows are the
/// functions at `held` places: by the equations of the places, which are few.
Matrix damped(const Functions& functions, const std::vector<Vec3>& held, const Matrix& data, Extended damping);

/// The displacements of control points that meet those of `held` places in the sense of least squares, with so many singular
/// values: k x 3.
Matrix manipulated(const Functions& functions, const std::vector<Vec3>& held, const Matrix& data, std::size_t rank);

}  // namespace deform::test::dense_controls
