// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstddef>
#include <memory>
#include <vector>

#include "core/base/run_context.h"
#include "core/deformers/constrained/constrained_points.h"
#include "core/deformers/constrained/energy_solver.h"
#include "core/deformers/constrained/gauss_newton.h"
#include "core/deformers/constrained/global_step.h"
#include "core/deformers/constrained/reduced_energy.h"
#include "core/numerics/sparse/conjugate_gradients.h"

namespace deform {

/// An iterate of a constrained solution. Points are those that the solver sees (ConstraintSet::column).
struct ConstrainedState {
  Eigen::MatrixXd v;         ///< r x 3: change of the coefficients that reach the sets, relative to the unconstrained deformation
  std::vector<Vec3> points;  ///< N: the points of all sets, set by set
  std::vector<Vec3> targets;            ///< N: projections of these points
  std::vector<ShapeParameters> shapes;  ///< one for each set
  std::vector<double> squares;          ///< sum of squared distances from the projections, for each set
  /// Energy of the deformation above that without constraints, plus the weighted squares.
  double objective = 0;
};

/// A start for the solution of a similar design.
struct ConstrainedStart {
  Eigen::MatrixXd v;  ///< as in ConstrainedState
  std::vector<ShapeParameters> shapes;
};

struct ConstrainedResult {
  ConstrainedState before;  ///< the unconstrained deformation
  ConstrainedState after;
  std::vector<ConstrainedState> rounds;  ///< with multipliers: the results of all rounds but the last
  Eigen::MatrixXd w;                     ///< k x 3: all coefficients of `after`
  Eigen::MatrixXd free;                  ///< k x 3: those of `before`
  std::vector<double> objectives;        ///< after each accepted iteration of the last round, nonincreasing
  int iterations = 0;                    ///< global steps of all rounds
  int newton_steps = 0;
  bool converged = false;  ///< to the tolerance, in all rounds
  /// Not converged, but only as the tolerance is less than rounding allows: Newton steps come no nearer. `after` is the nearest
  /// state that was met.
  bool at_rounding = false;
  double error = 0;  ///< estimated rms distance of the points that the solver sees from the solution, unit coordinates
  /// Estimated changes of w that lead from the result of each round to its solution, and to those of rounds that were not
  /// made; k x 3 each.
  std::vector<Eigen::MatrixXd> left;

  /// The start for the next design.
  ConstrainedStart start() const {
    const ConstrainedState& first = rounds.empty() ? after : rounds.front();
    return {first.v, first.shapes};
  }
};

/// Minimizes the energy plus gamma_c times the squared distances of point sets from geometric shapes (thesis 8.5, eq. 8.15 to
/// 8.17; Bouaziz et al. 2012), by alternating projections of the sets (local step) and linear solves towards the projections
/// (global step) with one factorization.
///
///  - The iteration works on the functions that reach the sets (ReducedEnergy); the whole mesh and the other functions are
///    involved only before and after it.
///  - The alternation of projections and GlobalStep is accelerated (Anderson 1965; window 5). An accelerated step that increases
///    the objective is replaced by the plain one, which never does. The iteration stops when step * rho / (1 - rho) <= tolerance,
///    where rho is the observed contraction of the plain map, and the displacement that the unbalanced forces can still cause is
///    as small: first without the shapes, then that of the Newton step, which is not made.
///  - After `patience` iterations without convergence, Newton steps follow as long as they decrease the objective, and then the
///    alternation again. Their systems are solved by conjugate gradients with the Gauss-Newton matrix (in the coefficients and
///    the parameters of the shapes) as preconditioner, which lacks only the curvature of the shapes. By default patience is the
///    number of iterations that cost as much as a few Newton steps, so stiff weights and overlapping sets converge quickly where
///    factorizations are cheap.
///  - Where Newton steps change the objective by less than its rounding and no longer come nearer, the tolerance is less than
///    doubles can reach: the nearest state is the result, and rounds of multipliers go on from it as from a converged one.
///    Without Newton steps that is so after `most_idle` iterations that do not come nearer. A result that is not converged is the
///    nearest state of which the distance from the solution was estimated.
/// Not converging is a result, not an error. Immutable; any number of threads may solve at once.
class ConstrainedSolver {
 public:
  static constexpr int rounds = 3;  ///< of the method of multipliers: one more than the updates of the loads

  struct Options {
    double tolerance = 1e-7;     ///< unit coordinates, rms over the points of the sets as the solver sees them
    int most_iterations = 3000;  ///< for one design
    int patience = 0;            ///< iterations before Newton steps; 0 = by cost, 4..150
  };

  /// `values` is n x k, for all points of the mesh. `solver` must outlive this object. `delivered` may be null: then points are
  /// where the functions have them. Throws as EnergySolver does.
  ConstrainedSolver(const EnergySolver& solver, const FunctionRows& values, std::vector<ConstraintSet> sets,
                    const Options& options, std::size_t memory_limit, const RunContext& context,
                    const DeliveredRows* delivered = nullptr);

  const std::vector<ConstraintSet>& sets() const { return points_.sets(); }
  std::size_t bytes() const;
  /// The approximate memory of one solution or derivative, mostly for a Newton step.
  std::size_t working_bytes() const;

  /// The points of the mesh of a set in a state.
  std::vector<Vec3> mesh_points(std::size_t set, const ConstrainedState& at) const { return points_.mesh_points(set, at.points); }

  /// h: m x 3 prescribed displacements of EnergySolver. offsets: N displacements of the points of the sets that come on top of
  /// those of the functions, nonzero only for eliminated handle and fixed points and with DeliveredRows. start: that of a similar
  /// design, or null; used if it is better than the unconstrained deformation.
  ConstrainedResult solve(const Eigen::MatrixXd& h, const std::vector<Vec3>& offsets, const RunContext& context,
                          const ConstrainedStart* start = nullptr) const;

  /// The derivative of a converged solution, k x 3, from dh (m x 3) and the derivative of the offsets. Solved by conjugate
  /// gradients to 1e-10 of the right-hand side.
  Eigen::MatrixXd derivative(const ConstrainedResult& at, const Eigen::MatrixXd& dh, const std::vector<Vec3>& offsets,
                             const RunContext& context) const;
  /// The transpose of derivative(): from g (k x 3) to h (m x 3) and N vectors for the offsets.
  struct Adjoint {
    Eigen::MatrixXd h;
    std::vector<Vec3> offsets;
  };
  Adjoint adjoint(const ConstrainedResult& at, const Eigen::MatrixXd& g, const RunContext& context) const;

 private:
  using NewtonMatrix = std::shared_ptr<const GaussNewton::Matrix>;

  /// The data of one solution.
  struct Case {
    std::vector<Vec3> unconstrained;  ///< N
    const RunContext& context;
  };

  /// The direction of a Newton step.
  struct Direction {
    Eigen::MatrixXd v;
    GradientsEnd end = GradientsEnd::converged;  ///< how it was solved for
    double gain = 0;                             ///< of a Newton step: what it lowers the objective by, to first order
  };

  /// What one round has met so far.
  struct Search {
    NewtonMatrix matrix;  ///< of an earlier step, or null
    /// The state with the smallest estimated distance from the solution, and what is left from there.
    ConstrainedState nearest{};
    Eigen::MatrixXd left{};
    double error = HUGE_VAL;

    void offer(const ConstrainedState& state, const Eigen::MatrixXd& to_go, double distance);
    /// Forgets the states, not the matrix.
    void restart() { error = HUGE_VAL; }
  };

  int patience_by_cost() const;
  void evaluate(const Case& c, ConstrainedState& state) const;
  Eigen::MatrixXd alternate(const Case& c, int most, Search& search, ConstrainedResult& result) const;
  Eigen::MatrixXd end_at_rounding(const Search& search, ConstrainedResult& result) const;
  Eigen::MatrixXd take_nearest(const Case& c, const Search& search, Eigen::MatrixXd left, ConstrainedResult& result) const;
  bool take_nearer_shapes(const Case& c, ConstrainedResult& result) const;
  Eigen::MatrixXd response(const Case& c, Eigen::MatrixXd forces) const;
  Eigen::MatrixXd newton(const Case& c, Search& search, ConstrainedResult& result) const;
  Direction newton_direction(const ConstrainedState& at, NewtonMatrix& matrix, const RunContext& context) const;
  Direction linearized_direction(const ConstrainedState& at, const RunContext& context) const;
  Eigen::MatrixXd gradient(const ConstrainedState& at) const;
  NewtonMatrix newton_at(const ConstrainedState& at, const RunContext& context) const;
  std::vector<Vec3> residual_change(const ConstrainedState& at, const std::vector<Vec3>& dx) const;
  void add_to_offsets(const ConstrainedState& at, const std::vector<Vec3>& dx, double sign, std::vector<Vec3>& offsets) const;
  Eigen::MatrixXd solve_linearized(const ConstrainedState& at, const GaussNewton::Matrix* newton, const Eigen::MatrixXd& b,
                                   double accuracy, const RunContext& context, int most = 1000,
                                   GradientsEnd* end = nullptr) const;
  Eigen::MatrixXd linearized_solution(const ConstrainedState& at, const Eigen::MatrixXd& b, const RunContext& context,
                                      const std::vector<Vec3>* offsets = nullptr) const;

  const EnergySolver& solver_;
  const Options options_;
  Eigen::MatrixXd delivered_values_;  ///< of a basis, until the points have them
  const ReducedEnergy reduced_;
  const ConstrainedPoints points_;
  const GlobalStep global_step_;
  const GaussNewton gauss_newton_;
  const int patience_;
};

}  // namespace deform
