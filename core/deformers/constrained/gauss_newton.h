// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/base/run_context.h"
#include "core/deformers/constrained/constrained_points.h"
#include "core/deformers/constrained/newton_form.h"
#include "core/deformers/constrained/reduced_energy.h"

namespace deform {

/// The Gauss-Newton matrices of constrained deformations: those of the energy plus the squared linearized distances, as functions
/// of the coefficients and the parameters of the shapes. With the derivatives J and P of the distances with respect to
/// coefficients and parameters, and their weights G,
///   [S + J^T G J   J^T G P] [x]   [b]        or, with the forces f = G (J x + P q):   [J S^-1 J^T + G^-1   -P] [f]   [J S^-1 b]
///   [P^T G J       P^T G P] [q] = [0]                                                 [P^T                  0] [q] = [0]
/// which has one unknown per distance. This class holds the common part of the matrices at all states. Immutable; any thread.
class GaussNewton {
 public:
  class Matrix;

  /// Chooses the form by cost. `global_step` is the factor of the matrix of GlobalStep. `points` and `energy` must outlive
  /// this object.
  GaussNewton(const ConstrainedPoints& points, const ReducedEnergy& energy, const SparseCholesky& global_step,
              std::size_t memory_limit, const RunContext& context);

  NewtonForm form() const { return form_; }
  double operations() const { return operations_; }           ///< operations of one Newton step
  std::size_t matrix_bytes() const { return matrix_bytes_; }  ///< memory of one matrix
  std::size_t bytes() const { return static_cast<std::size_t>(compliance_.size()) * sizeof(double); }

  /// The factored matrix at a state; null if it is too expensive or not positive definite to working precision.
  std::shared_ptr<const Matrix> at(const std::vector<Vec3>& points, const std::vector<ShapeParameters>& shapes,
                                   const RunContext& context) const;

 private:
  void prepare_compliance(const RunContext& context);

  const ConstrainedPoints& points_;
  const ReducedEnergy& energy_;
  NewtonForm form_ = NewtonForm::none;  ///< the one with the fewest operations
  double operations_ = 0;
  std::size_t matrix_bytes_ = 0;
  std::vector<std::int64_t> order_;  ///< elimination order of the functions in the sparse form
  Eigen::MatrixXd compliance_;       ///< Phi S^-1 Phi^T, N x N, for the form in forces; otherwise empty
};

/// The factored matrix at one state.
class GaussNewton::Matrix {
 public:
  Matrix(const GaussNewton& common, const std::vector<Vec3>& points, const std::vector<ShapeParameters>& shapes,
         const RunContext& context);

  /// The first rows of H^-1 [b; 0]: b and the result are r x 3.
  Eigen::MatrixXd inverse(const Eigen::MatrixXd& b) const;

 private:
  /// One row of the linearized distances times the root of its weight.
  struct Row {
    std::vector<std::int64_t> columns;
    std::vector<double> values;
  };
  void linearize(const std::vector<Vec3>& points, const std::vector<ShapeParameters>& shapes, const RunContext& context);
  void add_point(std::size_t point, double root, const Vec3& normal, Row& row) const;
  template <typename Use>
  void for_each_row(const Use& use) const;
  template <typename Use>
  void for_each_distance(const Use& use) const;
  Eigen::VectorXd inverse_full(Eigen::VectorXd b) const;
  void factor_full();
  void make_forces(const RunContext& context);
  void make_full(const RunContext& context);
  void add_dense_rows(const RunContext& context);
  void make_sparse(const RunContext& context);
  /// The forces f for given distances (one per row), and the resulting change of the coefficients, S^-1 J^T f.
  Eigen::VectorXd forces_of(Eigen::VectorXd distances) const;
  Eigen::MatrixXd pushed_by(const Eigen::VectorXd& forces) const;
  Eigen::VectorXd distances_of(const Eigen::MatrixXd& v) const;

  const GaussNewton& common_;
  const ConstrainedPoints& points_;
  std::vector<Linearization> linear_;       ///< linearization of each set
  std::vector<std::int64_t> first_column_;  ///< first column of the parameters of each set
  std::int64_t functions_ = 0, size_ = 0;   ///< 3 r, and 3 r plus the number of parameters
  Eigen::MatrixXd full_;                    ///< lower Cholesky factor, or empty; for the form in forces that of J S^-1 J^T + G^-1
  Eigen::MatrixXd shapes_, by_shapes_;      ///< for the form in forces: P, and the inverse of that matrix times P
  Eigen::LLT<Eigen::MatrixXd> of_shapes_;   ///< P^T by_shapes_
  std::unique_ptr<const SparseCholesky> sparse_;
};

}  // namespace deform
