// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/constraints/projection.h"
#include "core/deformers/constrained/reduced_energy.h"
#include "core/mesh/mesh.h"
#include "core/numerics/sparse/function_rows.h"
#include "core/numerics/sparse/sparse.h"

namespace deform {

/// Points and what they are held to. Unit coordinates.
struct ConstraintSet {
  std::string name;
  std::shared_ptr<const Projection> projection;
  std::vector<PointId> ids;  ///< of all its regions, one after the other
  std::vector<Vec3> rest;    ///< of these points
  double weight = 0;         ///< gamma_c: of the mean square distance from the projection
};

/// The functions that some point of the sets is reached by; ascending. values: n x k at all points of the mesh.
std::vector<std::int64_t> functions_reaching(const FunctionRows& values, const std::vector<ConstraintSet>& sets);

/// The points of all sets, one set after the other, and the coefficients that move them: displacements Phi v with Phi of N x r
/// over the functions of a ReducedEnergy. Immutable; any thread.
class ConstrainedPoints {
 public:
  /// values: n x k at all points of the mesh.
  ConstrainedPoints(std::vector<ConstraintSet> sets, const FunctionRows& values, const ReducedEnergy& energy);

  const std::vector<ConstraintSet>& sets() const { return sets_; }
  std::size_t count() const { return first_.back(); }  ///< N
  std::size_t first(std::size_t set) const { return first_[set]; }
  std::size_t size(std::size_t set) const { return first_[set + 1] - first_[set]; }
  /// gamma_c over the number of its points.
  double weight_per_point(std::size_t set) const { return sets_[set].weight / static_cast<double>(sets_[set].ids.size()); }
  const SparseRows& phi() const { return phi_; }
  const SparseMatrix& weighted_transposed() const { return transposed_; }  ///< Phi^T times the weights per point, r x N
  std::size_t bytes() const;

  /// Phi v, from r x 3.
  std::vector<Vec3> displacements(const Eigen::MatrixXd& v) const;
  /// Phi^T times the weights times y: r x 3.
  Eigen::MatrixXd weighted_sums(const std::vector<Vec3>& y) const;
  /// dx - P'(x) dx: how the vectors from the projections to the points change.
  std::vector<Vec3> projection_residual_change(const std::vector<Vec3>& points, const std::vector<ShapeParameters>& shapes,
                                               const std::vector<Vec3>& dx) const;

 private:
  std::vector<ConstraintSet> sets_;
  std::vector<std::size_t> first_;  ///< sets + 1: where the points of each set start
  SparseRows phi_;
  SparseMatrix transposed_;
};

}  // namespace deform
