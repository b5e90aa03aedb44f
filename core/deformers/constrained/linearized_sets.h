// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/base/run_context.h"
#include "core/deformers/constrained/constrained_points.h"
#include "core/numerics/sparse/sparse_cholesky.h"

namespace deform {

/// Sets on common points, which are numbered from 0.
struct SetsOnPoints {
  std::vector<const ConstraintSet*> sets;          ///< not owned
  std::vector<std::vector<std::uint32_t>> places;  ///< points of each set
  std::vector<bool> moves;                         ///< whether each point may move
  std::size_t count() const { return moves.size(); }
};

/// Singular values below these thresholds count as zero: for the conditions of several sets on one point, and for those of shared
/// or fixed points on the shapes. Sets that agree at the solution agree only approximately before.
struct RankLimits {
  double points = 1e-6, shapes = 1e-6;
};

/// The linearized distances r + N d + Q q of sets from their shapes when points move by d and shapes change by q, and their
/// rank-revealing least-squares solution. The rows of one point (or of points paired by a relation) form a small block; the
/// singular value decomposition of its N eliminates the points and leaves equations for the shapes alone, which are solved by the
/// eigenvalues of their Gram matrix. For more than 400 shape parameters in total, Tikhonov regularization replaces the
/// truncation. Parameters of a shape are scaled to move its points by one, root mean square. Immutable; any thread.
class LinearizedSets {
 public:
  /// Linearizes at the points. `shapes` holds an earlier fit of each set, or nothing, and is replaced by the new fit. `forces`
  /// (for each set, at its points) may be empty; bounds are evaluated at points displaced along them, so that a bound with a
  /// force against it stays active.
  LinearizedSets(const SetsOnPoints& on, const std::vector<Vec3>& points, std::vector<ShapeParameters>& shapes,
                 const std::vector<std::vector<Vec3>>& forces, const RankLimits& limits, const RunContext& context);
  ~LinearizedSets();

  const Eigen::VectorXd& residual() const { return residual_; }  ///< r
  std::size_t point_rank() const { return point_rank_; }
  std::size_t shape_rank() const { return shape_rank_; }
  std::size_t bytes() const;

  /// The d closest to `wanted` among the minimizers of |rows + N d + Q q| over d and q; zero at fixed points.
  std::vector<Vec3> step(const std::vector<Vec3>& wanted, const Eigen::VectorXd& rows) const;
  /// The transpose of rows -> step(0, rows).
  Eigen::VectorXd adjoint(const std::vector<Vec3>& cotangent) const;
  /// The vectors N^T rows of each set at its points, including fixed ones.
  std::vector<std::vector<Vec3>> forces(const Eigen::VectorXd& rows) const;
  /// N d for the fixed points, and its transpose.
  Eigen::VectorXd held_rows(const std::vector<Vec3>& change) const;
  std::vector<Vec3> held_adjoint(const Eigen::VectorXd& rows) const;

 private:
  static constexpr std::uint32_t none = ~std::uint32_t{0};
  struct Row {
    std::uint32_t set = 0, place = 0, partner = none;  ///< positions in the set
    Eigen::Index parameters = 0;                       ///< its row in the parameters of the set
    Vec3 normal{}, partner_normal{};
  };
  /// Rows that share points that may move.
  struct Block {
    std::vector<std::uint32_t> rows, points;
    Eigen::MatrixXd U, V;    ///< N = U [S 0; 0 0] V^T with all of U; V has as many columns as the rank
    Eigen::VectorXd values;  ///< S
    Eigen::Index rank() const { return values.size(); }
  };
  class Shapes;

  void linearize(const std::vector<Vec3>& points, std::vector<ShapeParameters>& shapes,
                 const std::vector<std::vector<Vec3>>& forces);
  void scale_parameters(std::size_t set, const Eigen::MatrixXd& parameters);
  void make_blocks();
  void decompose(Block& block, double limit) const;
  void make_shapes(double limit, const RunContext& context);
  std::uint32_t point(const Row& row) const { return on_.places[row.set][row.place]; }
  std::uint32_t partner(const Row& row) const { return on_.places[row.set][row.partner]; }
  Eigen::MatrixXd block_parameters(const Block& block, std::vector<Eigen::Index>& columns) const;
  /// Q q at the rows of a block.
  Eigen::VectorXd shape_rows(const Block& block, const Eigen::VectorXd& q) const;
  void add_shape_adjoint(const Block& block, const Eigen::VectorXd& rows, Eigen::VectorXd& q) const;
  Eigen::VectorXd gathered(const Block& block, const std::vector<Vec3>& at) const;

  const SetsOnPoints& on_;
  std::vector<Row> rows_;
  Eigen::VectorXd residual_;
  std::vector<Eigen::MatrixXd> parameters_;  ///< scaled parameters of each set
  std::vector<Eigen::Index> first_;          ///< first parameter of each set
  Eigen::Index parameter_count_ = 0;
  std::vector<Block> blocks_;
  std::unique_ptr<const Shapes> shapes_;
  std::size_t point_rank_ = 0, shape_rank_ = 0;
};

}  // namespace deform
