// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Dense>
#include <memory>
#include <vector>

#include "core/deformers/constrained/constrained_solver.h"

namespace deform::bench {

/// The alternation of thesis 8.5 step by step, without acceleration and Newton steps, for comparison with ConstrainedSolver.
class PlainAlternation {
 public:
  /// How the global step frees a set of its translation.
  enum class Form {
    translations,  ///< as GlobalStep does
    mean_centred,  ///< the mean of the set is subtracted
    anchored,      ///< its first point is subtracted (8.5.1)
  };
  /// As ConstrainedSolver::solve(), without multipliers.
  PlainAlternation(const EnergySolver& solver, const SparseRows& values, const std::vector<ConstraintSet>& sets,
                   const Eigen::MatrixXd& h, const std::vector<Vec3>& offsets, Form form = Form::translations);

  /// One global step and the projections after it; returns the rms change of the projections.
  double step();
  const ConstrainedState& state() const { return state_; }
  /// All coefficients.
  Eigen::MatrixXd w() const { return free_ + reduced_.extended(state_.v, {}); }

 private:
  void project();
  /// C of one set, n x n.
  Eigen::MatrixXd centring(std::size_t set) const;
  Eigen::MatrixXd global_step(const std::vector<Vec3>& y) const;

  Form form_;
  ReducedEnergy reduced_;
  ConstrainedPoints points_;
  std::unique_ptr<const GlobalStep> translations_;
  Eigen::LLT<Eigen::MatrixXd> factor_;  ///< of the other forms
  Eigen::MatrixXd free_;                ///< the solution without constraints
  std::vector<Vec3> unconstrained_;
  ConstrainedState state_;
};

}  // namespace deform::bench
