#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/deformers/constrained_solver.h"

namespace deform {

/// The quadratic model about a state: energy plus the squares of the linearized distances, over the coefficients and the
/// parameters of the shapes (Gauss-Newton), factored. Full where the reduced energy is and the unknowns are few, else sparse.
/// Immutable; any thread.
class ConstrainedSolver::Newton {
 public:
  Newton(const ConstrainedSolver& solver, const ConstrainedState& at, const RunContext& context);

  /// Change of v to the least value of the model.
  Eigen::MatrixXd step() const;
  /// The first rows of H^-1 [b; 0]: b and the result are r x 3.
  Eigen::MatrixXd inverse(const Eigen::MatrixXd& b) const;

 private:
  /// One row of the linearized distances times the root of its weight.
  struct Row {
    std::vector<std::int64_t> columns;
    std::vector<double> values;
    double residual = 0;
  };
  void read_shapes(const ConstrainedState& at, const RunContext& context);
  void add_point(std::size_t point, double root, const Vec3& normal, Row& row) const;
  template <typename Use>
  void for_each_row(const Use& use) const;
  void make_full(const RunContext& context);
  void make_sparse(const RunContext& context);
  Eigen::VectorXd solved(Eigen::VectorXd b) const;

  const ConstrainedSolver& solver_;
  std::vector<Linearization> linear_;       ///< per set
  std::vector<std::int64_t> first_column_;  ///< per set: of its parameters
  std::int64_t functions_ = 0, size_ = 0;   ///< 3 r, and with the parameters
  Eigen::VectorXd right_;                   ///< minus half the gradient
  Eigen::MatrixXd full_;                    ///< lower Cholesky factor, or empty
  std::unique_ptr<const SparseCholesky> sparse_;
};

}  // namespace deform
