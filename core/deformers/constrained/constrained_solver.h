#pragma once

#include <Eigen/Core>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/constraints/projection.h"
#include "core/deformers/constrained/energy_solver.h"
#include "core/deformers/constrained/newton_form.h"
#include "core/deformers/constrained/reduced_energy.h"
#include "core/mesh/mesh.h"

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
std::vector<std::int64_t> functions_reaching(const SparseRows& values, const std::vector<ConstraintSet>& sets);

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
///  - Each set that moves with its points has its translation as one more unknown, min over c of |x_i - p_i - c|^2, which gives
///    the iterates of the mean-centred form with a sparse positive definite matrix. The alternation is accelerated (Anderson
///    1965; window 5): an accelerated step that lets the objective rise is thrown away for the plain one, which never does. It
///    ends when step * rho / (1 - rho) <= tolerance for the observed contraction rho of the plain map, and what the unbalanced
///    forces could still move is as small.
///  - When that has not happened after `patience` iterations, Newton steps follow, as long as they lower the objective; then the
///    alternation again. Their systems are solved by conjugate gradients with the Gauss-Newton matrix (in the coefficients and
///    the parameters of the shapes) as preconditioner, which leaves out the curvature of the shapes only. Patience is as many
///    iterations as cost what a few of these steps cost, so stiff weights and overlapping sets end quickly where factorizations
///    are cheap.
/// Not converging is a result. Immutable; any number of threads may solve at once.
class ConstrainedSolver {
 public:
  enum class Acceleration { none, anderson };
  /// How a set is freed of its translation in the global step. The thesis' forms are for comparison: the mean-centred one (its
  /// matrix is dense over each set) and that of 8.5.1, which subtracts the first point of the set instead of the mean (another
  /// fixed point; the objective may rise).
  enum class Form { bordered, mean_centred, anchored };
  struct Options {
    double tolerance = 1e-7;     ///< unit coordinates, rms over the points of the sets
    int most_iterations = 3000;  ///< of a design
    int patience = 0;            ///< iterations before Gauss-Newton; 0 = by cost, 8..150
    Acceleration acceleration = Acceleration::anderson;
    Form form = Form::bordered;
  };

  /// values: n x k at all points of the mesh. `solver` must outlive this. Throws as EnergySolver does.
  ConstrainedSolver(const EnergySolver& solver, const SparseRows& values, std::vector<ConstraintSet> sets, const Options& options,
                    std::size_t memory_limit, const RunContext& context);

  const std::vector<ConstraintSet>& sets() const { return sets_; }
  std::size_t point_count() const { return static_cast<std::size_t>(phi_.rows()); }
  std::size_t unknowns() const { return reduced_.size(); }  ///< r
  int patience() const { return patience_; }
  std::size_t bytes() const;
  /// About what one solution or derivative takes, mostly for a Newton step.
  std::size_t working_bytes() const { return working_bytes_; }

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
  class Newton;
  using NewtonPtr = std::shared_ptr<const Newton>;

  /// What one solution is about.
  struct Case {
    std::vector<Vec3> unconstrained;  ///< N
    const RunContext& context;
  };

  SparseMatrix constrained_matrix() const;
  double newton_by_cost(std::size_t memory_limit);
  int patience_by_cost(double newton_step) const;
  void prepare_compliance(const RunContext& context);
  Eigen::MatrixXd global_step(const Case& c, const std::vector<Vec3>& targets) const;
  void evaluate(const Case& c, ConstrainedState& state) const;
  void alternate(const Case& c, int most, ConstrainedResult& result) const;
  double distance_left(const Case& c, const std::vector<Vec3>& from, const std::vector<Vec3>& to) const;
  void newton(const Case& c, ConstrainedResult& result, NewtonPtr& matrix) const;
  Eigen::MatrixXd newton_direction(const ConstrainedState& at, NewtonPtr& matrix, const RunContext& context) const;
  std::vector<Vec3> centred(const std::vector<Vec3>& y) const;
  Eigen::MatrixXd solve_bordered(const Eigen::MatrixXd& top, const std::vector<Vec3>& at_points, const RunContext& context) const;
  std::vector<Vec3> rows_times(const Eigen::MatrixXd& v) const;
  Eigen::MatrixXd weighted_transposed(const std::vector<Vec3>& y) const;
  std::vector<Vec3> unmet(const ConstrainedState& at, const std::vector<Vec3>& dx) const;
  Eigen::MatrixXd solve_linearized(const ConstrainedState& at, const Newton* newton, const Eigen::MatrixXd& b, double accuracy,
                                   const RunContext& context, int most = 1000, bool* finished = nullptr) const;
  Eigen::MatrixXd linearized_solution(const ConstrainedState& at, const Eigen::MatrixXd& b, const RunContext& context) const;
  NewtonPtr newton_at(const ConstrainedState& at, const RunContext& context) const;
  double per_point(std::size_t set) const { return sets_[set].weight / static_cast<double>(sets_[set].ids.size()); }
  std::size_t set_size(std::size_t set) const { return first_[set + 1] - first_[set]; }

  static constexpr int rounds = 3;  ///< of multipliers: updates of the loads, and one

  const EnergySolver& solver_;
  std::vector<ConstraintSet> sets_;
  Options options_;
  std::vector<std::size_t> first_;  ///< sets + 1: where the points of each set start
  ReducedEnergy reduced_;
  SparseRows phi_;                         ///< N x r
  SparseMatrix transposed_;                ///< r x N, times the weights per point
  std::vector<std::int64_t> translation_;  ///< per set: row of its translation, or -1
  std::unique_ptr<const SparseCholesky> factor_;
  NewtonForm newton_form_ = NewtonForm::none;  ///< that takes the fewest operations
  std::vector<std::int64_t> newton_order_;     ///< elimination order of S, of the sparse form
  Eigen::MatrixXd compliance_;                 ///< N x N, Phi S^-1 Phi^T, of the form in forces; else empty
  int patience_ = 0;
  std::size_t working_bytes_ = 0;
};

}  // namespace deform
