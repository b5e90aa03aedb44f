// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/constraints/projection.h"
#include "core/deformers/constrained/dense_rows.h"
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

/// How the points of the sets follow the functions where what these miss at handle and fixed points is interpolated and added: by
/// the values of the functions less the interpolants of their values at handle and fixed points. So the solver works with the
/// points that are delivered. Not so those of columns of cells, which follow the functions alone, as LayerStep sets them up anew
/// at last. All functions reach all points.
struct DeliveredRows {
  std::vector<std::int64_t> functions;  ///< f, ascending: those that are nonzero at a handle or fixed point
  /// Ascending: points of the sets that are no columns, but for those that are held, which follow no function; and points of
  /// columns.
  std::vector<PointId> ids, columns;
  Eigen::MatrixXd interpolated;  ///< one row for each of ids, f columns

  /// Fills ids and columns.
  void take_points(const std::vector<ConstraintSet>& sets, const std::vector<bool>& held);
  std::size_t points() const { return ids.size() + columns.size(); }  ///< u
  PointId point(std::size_t row) const { return row < ids.size() ? ids[row] : columns[row - ids.size()]; }
  /// The row of a point of a set, from 0 to u, or u: it follows no function.
  std::size_t row_of(const ConstraintSet& set, PointId id) const;

  /// u x r, for the functions of `energy`; or for all functions, u x k, if it is null.
  Eigen::MatrixXd values(const FunctionRows& values, const ReducedEnergy* energy) const;

  /// How the solver works with so many points and functions, k in all: with functions, with a basis of ReducedEnergy, or not at
  /// all. Counts, unlike times, give the same choice on every machine.
  enum class Form { functions, basis, none };
  static Form form(std::size_t points, std::size_t reaching, std::size_t functions, std::size_t factor_entries);
  static constexpr std::size_t most_functions = 1200, most_entries = std::size_t{1} << 26;  ///< without a basis; u x k
};

/// The functions that are nonzero at some point of the sets, ascending. `values` is n x k, for all points of the mesh.
/// `delivered` may be null.
std::vector<std::int64_t> functions_reaching(const FunctionRows& values, const std::vector<ConstraintSet>& sets,
                                             const DeliveredRows* delivered = nullptr);

/// The points of all sets as the solver sees them (ConstraintSet::column), set by set, and their displacements Phi v, where the
/// N x r matrix Phi has the functions of a ReducedEnergy as columns. Phi is sparse or, with DeliveredRows, dense. Immutable; any
/// thread.
class ConstrainedPoints {
 public:
  /// `values` is n x k, for all points of the mesh. `delivered` may be null; `all` are its values for all functions if `energy`,
  /// which must outlive this object, has a basis.
  ConstrainedPoints(std::vector<ConstraintSet> sets, const FunctionRows& values, const ReducedEnergy& energy,
                    const DeliveredRows* delivered = nullptr, Eigen::MatrixXd all = {});

  const std::vector<ConstraintSet>& sets() const { return sets_; }
  std::size_t count() const { return first_.back(); }  ///< N
  std::size_t first(std::size_t set) const { return first_[set]; }
  std::size_t size(std::size_t set) const { return first_[set + 1] - first_[set]; }
  /// gamma_c of a set divided by the number of its points.
  double weight_per_point(std::size_t set) const { return sets_[set].weight / static_cast<double>(sets_[set].ids.size()); }
  /// Phi if it is dense, else null.
  const DenseRows* dense() const { return dense_ ? &*dense_ : nullptr; }
  /// Phi, and Phi^T times the weights per point (r x N); without entries if Phi is dense.
  const SparseRows& phi() const { return phi_; }
  const SparseMatrix& weighted_transposed() const { return transposed_; }
  std::size_t entries() const;  ///< stored for Phi
  std::size_t bytes() const;

  /// Vectors at the points of the mesh as vectors at those of the solver, and the transpose. Points of a set that is a column
  /// become those of the stretched one.
  std::vector<Vec3> stretched(std::vector<Vec3> x) const;
  std::vector<Vec3> stretched_adjoint(std::vector<Vec3> y) const;
  /// The points of the mesh of a set, from all points of the solver.
  std::vector<Vec3> mesh_points(std::size_t set, const std::vector<Vec3>& points) const;

  /// Returns Phi v (N) for v of size r x 3.
  std::vector<Vec3> displacements(const Eigen::MatrixXd& v) const;
  /// The same for coefficients w of all functions, k x 3.
  std::vector<Vec3> displacements_of_all(const Eigen::MatrixXd& w) const;
  /// The root mean square of Phi v and, of a dense Phi, also of what the functions alone have at the points that follow them, if
  /// that is larger: where they can hardly move the points that are delivered, they move others.
  double reach(const Eigen::MatrixXd& v) const;
  /// Returns Phi^T times the weights times y, r x 3.
  Eigen::MatrixXd weighted_sums(const std::vector<Vec3>& y) const;
  /// Returns dx - P'(x) dx, the change of the vectors from the projections to the points.
  std::vector<Vec3> projection_residual_change(const std::vector<Vec3>& points, const std::vector<ShapeParameters>& shapes,
                                               const std::vector<Vec3>& dx) const;

 private:
  /// x with the points of each column replaced by those that map(column, points) gives.
  template <typename Map>
  std::vector<Vec3> with_columns(std::vector<Vec3> x, const Map& map) const;
  template <typename Use>
  void for_each_row(const Use& use) const;
  void make_sparse(const FunctionRows& values, const std::vector<std::int64_t>& place);
  void make_dense(const FunctionRows& values, const DeliveredRows& delivered);

  const ReducedEnergy& energy_;
  std::vector<ConstraintSet> sets_;
  std::vector<std::size_t> first_;  ///< sets + 1 offsets of the points of each set
  SparseRows phi_;
  SparseMatrix transposed_;
  std::optional<DenseRows> dense_;
  SparseRows alone_;     ///< with a dense Phi: u x k, the values of the functions at the points that follow them
  Eigen::MatrixXd all_;  ///< with a basis: V of all functions, u x k
};

}  // namespace deform
