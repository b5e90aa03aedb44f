// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "core/deformers/constrained/constrained_solver.h"
#include "core/deformers/constrained/energy_solver.h"
#include "core/deformers/energy/exact_step.h"
#include "core/deformers/energy/layer_step.h"
#include "core/deformers/energy/residual_correction.h"
#include "core/deformers/energy/spaces/energy_space.h"
#include "core/deformers/handles/handle_system.h"

namespace deform {

/// Creates the space of a method with its handle and fixed points, from the regions of the points and the diagonal D.
using MakeEnergyModel = std::function<EnergyModel(const std::vector<RegionIndex>& region_of, double diagonal)>;

/// The deformation of least energy in an energy space (thesis 3.1, 8.2 to 8.4), with one sparse factorization for all designs.
/// Differences from System:
///  - Hard handles: handle and fixed points are set exactly, as for RBF. The shell eliminates them. Other spaces cannot represent
///    every prescribed displacement; their misfit is interpolated and added (ResidualCorrection). report().interpolation_residual
///    is the largest remaining misfit at up to 256 handle and fixed points, 0 for the shell.
///  - Soft handles (thesis eq. 8.8): handle and fixed points follow the solution like all others. The mean square misfit of each
///    handle, and of the fixed points, has the weight `fixing`; interpolation_residual is the largest misfit.
///  - Constraints (thesis 8.5) are solved for in bind(), starting each design from its unconstrained deformation, so that
///    designs do not depend on each other, or in bind_sequence(). There is no basis then, and derivatives are those of the
///    constrained deformation. Exact constraints end with an ExactStep (ConstraintReport::given_up if it is omitted;
///    derivatives omit it as well). With columns of cells a LayerStep follows.
/// Coincident handle or fixed points may be moved to different places with the shell (a crack opens), but not with other spaces.
class EnergySystem : public HandleSystem {
 public:
  EnergySystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const EnergyOptions& options, const MakeEnergyModel& model,
               const RunContext& context, std::size_t memory_budget);

  std::unique_ptr<const Evaluation> bind(std::span<const Design> designs, EvaluationPath path,
                                         const RunContext& context) const override;
  std::unique_ptr<const Evaluation> bind_sequence(std::span<const Design> designs, EvaluationPath path, WarmStart& warm,
                                                  const RunContext& context) const override;

 private:
  friend class EnergyEvaluation;

  /// The solution for one design or for several fields.
  struct Solution {
    EnergyField field;
    ExactStep::Step exact;
    LayerStep::Step layers;
    std::vector<double> misfits;  ///< largest |value - prescribed| of each column at the sampled handle and fixed points
    /// Estimated largest error of each column at the following points, but for `misfits`; empty if not measured.
    std::vector<double> errors;
  };

  /// The prescribed displacements or their derivatives, in units of D.
  struct Prescribed {
    Eigen::MatrixXd h;          ///< m x 3, of the handle and fixed points that enter the system
    std::vector<Vec3> offsets;  ///< as in ConstrainedSolver::solve()
  };

  /// A constrained design, the positions of its exact points, and those of the columns of cells before the last step.
  struct Constrained {
    ConstrainedResult result;
    ExactPlacement::Placed exact;
    std::vector<Vec3> layers;  ///< LayerStep::Step::from
  };

  std::unique_ptr<const Evaluation> derivative(std::span<const double> variables, const std::vector<Affine>& maps,
                                               const RunContext& context) const override;
  Fields adjoint(std::span<const double> variables, Cotangents at_following, const RunContext& context) const override;
  std::string only_on_mesh() const override { return model_.space.in_space ? std::string() : model_.space.only_on_mesh; }
  void prepare_solver(const RunContext& context, std::size_t memory_budget);
  void prepare_constraints(ConstraintSets constraints, const RunContext& context, std::size_t memory_budget);
  std::optional<DeliveredRows> delivered_rows(const std::vector<ConstraintSet>& sets, const RunContext& context);
  void prepare_basis(const RunContext& context, std::size_t memory_budget);
  void fill_info();
  Eigen::MatrixXd fields_at_held(std::size_t handle) const;
  Eigen::MatrixXd shifted_handles(const std::vector<std::size_t>& group_of) const;
  Solution solve(const Eigen::MatrixXd& h, const RunContext& context) const;
  Eigen::MatrixXd misfit(const Eigen::MatrixXd& h, const Eigen::MatrixXd& w) const;
  /// Prescribed - actual values at the sampled handle and fixed points, one row each.
  Eigen::MatrixXd sampled_misfit(const Eigen::MatrixXd& h, const EnergyField& field, const RunContext& context) const;
  /// The estimated largest error of column c: with hard handles the misfit affects the points next to them.
  double error(const Solution& solution, std::size_t c) const {
    return solution.errors[c] + (hard_handles() ? solution.misfits[c] : 0.0);
  }
  void measure_errors(const EnergyField& change, Solution& solution, const RunContext& context) const;
  /// The largest one at the points of the sets and at samples of the following points, for coefficients w (k x 3).
  double largest_displacement(const Eigen::MatrixXd& w, const RunContext& context) const;
  Eigen::MatrixXd at_samples(const EnergyField& field) const;
  Solution completed(const Eigen::MatrixXd& h, const Eigen::MatrixXd& w, const RunContext& context) const;
  Prescribed prescribed(const BoundDesign& design, MotionKind kind, const RunContext& context) const;
  /// Whether the solver sees the points of a set with the correction.
  bool is_delivered(const ConstraintSet& set) const { return delivered_ && set.column == nullptr; }
  std::vector<Vec3> offsets_of(const Eigen::MatrixXd& h, const RunContext& context) const;
  /// Where the points of the sets are, set by set, or how they change there; unit coordinates.
  std::vector<Vec3> set_points(const Solution& solution, const BoundDesign& design, MotionKind kind) const;
  /// Those of these points that LayerStep::ids() names.
  std::vector<Vec3> layer_points(const std::vector<Vec3>& of_sets) const;
  void prepare_steps(const RunContext& context);
  Constrained constrained_at(std::span<const double> variables, const RunContext& context) const;
  /// Writes the values of a solution at a tile of the following points to out[c][16].
  void fill_tile(const Solution& solution, std::size_t tile, double* out) const;
  std::vector<double> constrained_adjoint(const Constrained& at, const Eigen::MatrixXd& g, const Eigen::MatrixXd& direct,
                                          const std::vector<Vec3>& at_exact, const std::vector<Vec3>& at_layers,
                                          const RunContext& context) const;
  void add_fields(PointId id, const Vec3& cotangent, std::vector<double>& fields) const;
  std::vector<double> contract_fields(const Eigen::MatrixXd& back) const;

  const EnergyOptions options_;
  EnergyModel model_;
  std::unique_ptr<const EnergySolver> solver_;
  std::unique_ptr<const ResidualCorrection> correction_;  ///< null for the shell and soft handles
  std::unique_ptr<const ConstrainedSolver> constrained_;  ///< null without constraints
  bool delivered_ = false;                                ///< whether its points are those with the correction (DeliveredRows)
  std::vector<std::size_t> constraint_of_;                ///< constraint of each set
  TiledPoints set_places_;                                ///< points of the sets; only with a correction or exact constraints
  std::unique_ptr<const ExactStep> exact_;                ///< null without exact constraints
  std::unique_ptr<const LayerStep> layers_;               ///< null without columns of cells that the step would move
  std::vector<std::size_t> checked_;                      ///< held points at which misfits are measured; none of the shell
  std::vector<std::uint32_t> samples_;                    ///< following points at which errors are measured
  double missed_ = 0;             ///< with a correction: largest misfit of the functions where handles shift, over the shift
  double linear_error_ = 0;       ///< with constraints: error of the linear solves but for misfits, relative to the motion
  TiledPoints following_places_;  ///< unit coordinates; only with a correction or exact constraints
};

}  // namespace deform
