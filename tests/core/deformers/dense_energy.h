// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

#include "core/deformers/energy/spaces/energy_space.h"
#include "core/deformers/setup.h"
#include "tests/support/linear_algebra.h"

/// Dense solutions of the energy methods whose residuals carry twice the digits. The functions and the energies of their spaces
/// are those of the product, which belong to the method; equations, factors, steps of the multipliers, interpolation of what
/// these leave and sums are not.
namespace deform::test::dense_energy {

__extension__ typedef __float128 Quad;
using Extended = long double;
using Matrix = Eigen::Matrix<Extended, Eigen::Dynamic, Eigen::Dynamic>;
using Field = std::vector<std::array<Quad, 3>>;

const EnergyOptions& energy_options(const MethodOptions& method);

/// Weighted rows of held points, energy and prescribed displacements.
struct Equations {
  const EnergyModel& model;
  std::vector<std::vector<std::pair<Eigen::Index, double>>> rows;  ///< of held points; of an eliminated model the columns of R
  std::vector<double> weights;
  Field h;
  Eigen::Index unknowns;

  /// K w
  Field energy(const Field& w) const;
  /// h - B w
  Field misfit(const Field& w) const;
  /// R u, or B^T W u.
  Field right_side(Field u) const;
  /// Adds B^T x.
  void add_transposed(const Field& x, Field& to) const;
};

Quad largest(const Field& field);

/// Dense LU in extended precision, with refinement in quadruple precision.
class Factor {
 public:
  explicit Factor(const Equations& of);
  const Matrix& matrix() const { return A_; }
  /// x of (K + B^T W B) x = b, or of K x = b
  Field solve(const Field& b) const;

  /// b - (K + B^T W B) x, or b - K x
  Field residual(const Field& b, const Field& x) const;

 private:
  const Equations& of_;
  Matrix A_;
  Lu<Extended> lu_;
};

/// The loads of the last step, with multipliers of several.
Field loads(const Equations& equations, const Factor& factor, bool multipliers);

/// The coefficients of the solution.
Field solution(const Equations& equations, bool soft);

/// The solutions of one setup.
class Oracle {
 public:
  Oracle(const Mesh& mesh, const MethodOptions& method, std::uint64_t seed, const std::vector<RegionIndex>& region_of);
  Oracle(const Oracle&) = delete;
  Oracle& operator=(const Oracle&) = delete;

  std::size_t unknowns() const { return static_cast<std::size_t>(model_.space.energy.rows()); }
  /// Whether the solution has one linear system: not with multipliers, whose steps belong to the method.
  bool one_system() const { return soft_ || model_.eliminated; }
  bool soft() const { return soft_; }
  /// Whether no function reaches handle and fixed points.
  bool eliminated() const { return model_.eliminated; }
  /// Handle and fixed points that enter the system.
  const std::vector<PointId>& held() const { return model_.held; }
  const Box& box() const { return box_; }
  std::vector<std::pair<Eigen::Index, double>> functions_at(PointId id) const;

  /// What is added at points (rows) for a misfit of one at a held point (columns).
  Matrix interpolation_at(const std::vector<PointId>& ids) const;

  /// The displacements of all points, from those that handle and fixed points are to have.
  std::vector<std::array<Extended, 3>> displacements(const MethodOptions& method,
                                                     const std::function<std::array<Quad, 3>(PointId)>& prescribed) const;
  /// The same with the coefficients from `solve`.
  std::vector<std::array<Extended, 3>> displacements(const MethodOptions& method,
                                                     const std::function<std::array<Quad, 3>(PointId)>& prescribed,
                                                     const std::function<Field(const Equations&)>& solve) const;

 private:
  Vec3 unit(PointId id) const { return (1 / box_.diagonal()) * (mesh_.points[id] - box_.min); }

  void make_model(const MethodOptions& method, std::uint64_t seed);

  Equations equations_of(double fixing, const std::function<std::array<Quad, 3>(PointId)>& prescribed) const;

  /// What the multipliers leave at hard handles, interpolated.
  Matrix corrections(const Equations& equations, const Field& w, const std::vector<Vec3>& places) const;

  const Mesh& mesh_;
  const std::vector<RegionIndex> region_of_;
  const bool soft_;
  EnergyModel model_;
  Box box_;
};

}  // namespace deform::test::dense_energy
