// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <vector>

#include "core/base/run_context.h"
#include "core/deformers/constrained/constrained_points.h"
#include "core/deformers/constrained/energy_solver.h"
#include "core/deformers/constrained/gauss_newton.h"
#include "core/deformers/constrained/global_step.h"
#include "core/deformers/constrained/reduced_energy.h"

namespace deform {

/// Where a constrained solution stands.
struct ConstrainedState {
  Eigen::MatrixXd v;          ///< r x 3: change of the coefficients that reach the sets, from the deformation without them
  std::vector<Vec3> points;   ///< N: the points of all sets, one set after the other
  std::vector<Vec3> targets;  ///< N: their projections
  std::vector<ShapeParameters> shapes;  ///< per set
  std::vector<double> squares;          ///< per set: sum of squared distances from the projections
  /// Energy of the deformation above that without constraints, plus the weighted squares.
  double objective = 0;
};

/// What a similar design may start from.
struct ConstrainedStart {
  Eigen::MatrixXd v;  ///< as in ConstrainedState
  std::vector<ShapeParameters> shapes;
};

struct ConstrainedResult {
  ConstrainedState before;  ///< of the unconstrained deformation
  ConstrainedState after;
  std::vector<ConstrainedState> rounds;  ///< with multipliers: the ends of the rounds before the last
  Eigen::MatrixXd w;                     ///< k x 3: all coefficients, after
  std::vector<double> objectives;        ///< after each accepted iteration of the last round, never rising
  int iterations = 0;                    ///< global steps of all rounds
  int newton_steps = 0;
  bool converged = false;
  double error = 0;  ///< estimate of how far the points still are from the solution, rms, unit coordinates

  /// For the next design.
  ConstrainedStart start() const {
    const ConstrainedState& first = rounds.empty() ? after : rounds.front();
    return {first.v, first.shapes};
  }
};

/// The deformation of least energy plus gamma_c times the distances of some point sets from geometric shapes (thesis 8.5,
/// eq. 8.15 to 8.17; Bouaziz et al. 2012), by alternating projections of the sets (local step) and a linear solution towards the
/// projections (global step) with one factorization.
///
///  - Everything is about the functions that reach the sets (ReducedEnergy): the whole mesh and the other functions are only
///    touched before and after.
///  - The alternation of projections and GlobalStep is accelerated (Anderson 1965; window 5): an accelerated step that lets the
///    objective rise is thrown away for the plain one, which never does. It ends when step * rho / (1 - rho) <= tolerance for the
///    observed contraction rho of the plain map, and what the unbalanced forces could still move is as small.
///  - When that has not happened after `patience` iterations, Newton steps follow, as long as they lower the objective; then the
///    alternation again. Their systems are solved by conjugate gradients with the Gauss-Newton matrix (in the coefficients and
///    the parameters of the shapes) as preconditioner, which leaves out the curvature of the shapes only. Patience is as many
///    iterations as cost what a few of these steps cost, so stiff weights and overlapping sets end quickly where factorizations
///    are cheap.
/// Not converging is a result. Immutable; any number of threads may solve at once.
class ConstrainedSolver {
 public:
  struct Options {
    double tolerance = 1e-7;     ///< unit coordinates, rms over the points of the sets
    int most_iterations = 3000;  ///< of a design
    int patience = 0;            ///< iterations before Gauss-Newton; 0 = by cost, 4..150
  };

  /// values: n x k at all points of the mesh. `solver` must outlive this. Throws as EnergySolver does.
  ConstrainedSolver(const EnergySolver& solver, const FunctionRows& values, std::vector<ConstraintSet> sets,
                    const Options& options, std::size_t memory_limit, const RunContext& context);

  const std::vector<ConstraintSet>& sets() const { return points_.sets(); }
  std::size_t bytes() const;
  /// About what one solution or derivative takes, mostly for a Newton step.
  std::size_t working_bytes() const;

  /// h: m x 3 prescribed displacements of EnergySolver; offsets: N displacements of the points of the sets that no function
  /// reaches (eliminated held points), zero for the others. start: of a similar design, or null; taken when it is better than
  /// the deformation without constraints.
  ConstrainedResult solve(const Eigen::MatrixXd& h, const std::vector<Vec3>& offsets, const RunContext& context,
                          const ConstrainedStart* start = nullptr) const;

  /// Derivative of a converged solution: k x 3 from dh (m x 3) and the derivative of the offsets. Conjugate gradients; exact up
  /// to 1e-10 of the right-hand side.
  Eigen::MatrixXd derivative(const ConstrainedResult& at, const Eigen::MatrixXd& dh, const std::vector<Vec3>& offsets,
                             const RunContext& context) const;
  /// Its transpose: from g (k x 3) to m x 3, and N vectors at the offsets.
  struct Adjoint {
    Eigen::MatrixXd h;
    std::vector<Vec3> offsets;
  };
  Adjoint adjoint(const ConstrainedResult& at, const Eigen::MatrixXd& g, const RunContext& context) const;

 private:
  using NewtonMatrix = std::shared_ptr<const GaussNewton::Matrix>;

  /// What one solution is about.
  struct Case {
    std::vector<Vec3> unconstrained;  ///< N
    const RunContext& context;
  };

  int patience_by_cost() const;
  void evaluate(const Case& c, ConstrainedState& state) const;
  void alternate(const Case& c, int most, ConstrainedResult& result) const;
  double distance_left(const Case& c, const std::vector<Vec3>& from, const std::vector<Vec3>& to) const;
  void newton(const Case& c, ConstrainedResult& result, NewtonMatrix& matrix) const;
  Eigen::MatrixXd newton_direction(const ConstrainedState& at, NewtonMatrix& matrix, const RunContext& context) const;
  NewtonMatrix newton_at(const ConstrainedState& at, const RunContext& context) const;
  std::vector<Vec3> residual_change(const ConstrainedState& at, const std::vector<Vec3>& dx) const;
  Eigen::MatrixXd solve_linearized(const ConstrainedState& at, const GaussNewton::Matrix* newton, const Eigen::MatrixXd& b,
                                   double accuracy, const RunContext& context, int most = 1000, bool* finished = nullptr) const;
  Eigen::MatrixXd linearized_solution(const ConstrainedState& at, const Eigen::MatrixXd& b, const RunContext& context) const;

  static constexpr int rounds = 3;  ///< of multipliers: updates of the loads, and one

  const EnergySolver& solver_;
  const Options options_;
  const ReducedEnergy reduced_;
  const ConstrainedPoints points_;
  const GlobalStep global_step_;
  const GaussNewton gauss_newton_;
  const int patience_;
};

}  // namespace deform
