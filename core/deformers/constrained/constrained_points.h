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
#include "core/deformers/constrained/stretched_column.h"
#include "core/mesh/mesh.h"
#include "core/numerics/sparse/function_rows.h"
#include "core/numerics/sparse/sparse.h"

namespace deform {

/// A set of points with its constraint, in unit coordinates.
struct ConstraintSet {
  std::string name;
  std::shared_ptr<const Projection> projection;
  std::vector<PointId> ids;  ///< points of all its regions, region by region
  std::vector<Vec3> rest;    ///< rest positions of these points
  double weight = 0;         ///< gamma_c, the weight of the mean squared distance from the projection
  /// If not null, the solver sees the points as those of this column: the projection and the rest positions that it works with
  /// are solved_projection() and solved_rest(). Reports and exact placement work with those of the points themselves.
  std::shared_ptr<const StretchedColumn> column{};

  const Projection& solved_projection() const { return column ? column->projection() : *projection; }
  const std::vector<Vec3>& solved_rest() const { return column ? column->rest() : rest; }
};

/// The functions that are nonzero at some point of the sets, ascending. `values` is n x k, for all points of the mesh.
std::vector<std::int64_t> functions_reaching(const FunctionRows& values, const std::vector<ConstraintSet>& sets);

/// The points of all sets as the solver sees them (ConstraintSet::column), set by set, and their displacements Phi v, where the
/// N x r matrix Phi has the functions of a ReducedEnergy as columns. Immutable; any thread.
class ConstrainedPoints {
 public:
  /// `values` is n x k, for all points of the mesh.
  ConstrainedPoints(std::vector<ConstraintSet> sets, const FunctionRows& values, const ReducedEnergy& energy);

  const std::vector<ConstraintSet>& sets() const { return sets_; }
  std::size_t count() const { return first_.back(); }  ///< N
  std::size_t first(std::size_t set) const { return first_[set]; }
  std::size_t size(std::size_t set) const { return first_[set + 1] - first_[set]; }
  /// gamma_c of a set divided by the number of its points.
  double weight_per_point(std::size_t set) const { return sets_[set].weight / static_cast<double>(sets_[set].ids.size()); }
  const SparseRows& phi() const { return phi_; }
  const SparseMatrix& weighted_transposed() const { return transposed_; }  ///< Phi^T times the weights per point, r x N
  std::size_t bytes() const;

  /// Vectors at the points of the mesh as vectors at those of the solver, and the transpose. Points of a set that is a column
  /// become those of the stretched one.
  std::vector<Vec3> stretched(std::vector<Vec3> x) const;
  std::vector<Vec3> stretched_adjoint(std::vector<Vec3> y) const;
  /// The points of the mesh of a set, from all points of the solver.
  std::vector<Vec3> mesh_points(std::size_t set, const std::vector<Vec3>& points) const;

  /// Returns Phi v (N) for v of size r x 3.
  std::vector<Vec3> displacements(const Eigen::MatrixXd& v) const;
  /// Returns Phi^T times the weights times y, r x 3.
  Eigen::MatrixXd weighted_sums(const std::vector<Vec3>& y) const;
  /// Returns dx - P'(x) dx, the change of the vectors from the projections to the points.
  std::vector<Vec3> projection_residual_change(const std::vector<Vec3>& points, const std::vector<ShapeParameters>& shapes,
                                               const std::vector<Vec3>& dx) const;

 private:
  /// x with the points of each column replaced by those that map(column, points) gives.
  template <typename Map>
  std::vector<Vec3> with_columns(std::vector<Vec3> x, const Map& map) const;

  std::vector<ConstraintSet> sets_;
  std::vector<std::size_t> first_;  ///< sets + 1 offsets of the points of each set
  SparseRows phi_;
  SparseMatrix transposed_;
};

}  // namespace deform
