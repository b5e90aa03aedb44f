// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <vector>

#include "core/deformers/constrained/constrained_solver.h"
#include "core/deformers/constrained/energy_solver.h"
#include "core/deformers/energy/exact_step.h"
#include "core/deformers/energy/residual_correction.h"
#include "core/deformers/energy/spaces/energy_space.h"
#include "core/deformers/handles/handle_system.h"

namespace deform {

/// The space of a method and its held points, from the regions of the points and the diagonal D.
using MakeEnergyModel = std::function<EnergyModel(const std::vector<RegionIndex>& region_of, double diagonal)>;

/// The deformation of least energy over an energy space (thesis 3.1, 8.2 to 8.4): one sparse factorization, then designs. What
/// differs from System:
///  - Hard handles: held points are set exactly, as for RBF. The shell eliminates them. Other spaces cannot meet every prescribed
///    displacement; what they leave is interpolated and added (ResidualCorrection). report().interpolation_residual is the
///    largest remaining misfit, at up to 256 held points (an upper bound on the basis path); 0 for the shell.
///  - Soft handles (thesis eq. 8.8): held points follow the solution as all others do, each handle and the fixed points with
///  weight
///    `fixing` for the mean square of their misfit; interpolation_residual is the largest misfit.
///  - Constraints (thesis 8.5) are solved for in bind(), each design from its deformation without them, so that designs do not
///    depend on each other; or in bind_sequence(). There is no basis then, and derivatives are those of the constrained
///    deformation. Exact constraints take an ExactStep at the end (ConstraintReport::given_up where it is left out; derivatives
///    then leave it out as well).
/// Coincident held points may go to different places with the shell (a crack opens), not with the others.
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

  /// Of one design or of some fields.
  struct Solution {
    EnergyField field;
    ExactStep::Step exact;
    std::vector<double> misfits;  ///< c: largest |value - prescribed| at the samples of the held points
    std::vector<double> errors;   ///< c: estimated largest error at the following points; empty: not measured
  };

  /// Prescribed displacements or their derivatives, in units of D.
  struct Prescribed {
    Eigen::MatrixXd h;          ///< m x 3, of the held points that count
    std::vector<Vec3> offsets;  ///< of the points of the constraints that no function reaches, zero for the others
  };

  /// A constrained design and where its exact points are.
  struct Constrained {
    ConstrainedResult result;
    ExactPlacement::Placed exact;
  };

  std::unique_ptr<const Evaluation> derivative(std::span<const double> variables, const std::vector<Affine>& maps,
                                               const RunContext& context) const override;
  std::vector<double> adjoint(std::span<const double> variables, const std::vector<Vec3>& at_following,
                              const RunContext& context) const override;
  void prepare_solver(const RunContext& context, std::size_t memory_budget);
  void prepare_constraints(ConstraintSets constraints, const RunContext& context, std::size_t memory_budget);
  void prepare_basis(const RunContext& context, std::size_t memory_budget);
  void fill_info();
  Eigen::MatrixXd fields_at_held(std::size_t handle) const;
  Solution solve(const Eigen::MatrixXd& h, const RunContext& context) const;
  Eigen::MatrixXd misfit(const Eigen::MatrixXd& h, const Eigen::MatrixXd& w) const;
  void measure(const Eigen::MatrixXd& h, Solution& solution) const;
  void measure_errors(const EnergyField& change, Solution& solution) const;
  Solution completed(const Eigen::MatrixXd& h, const Eigen::MatrixXd& w, const RunContext& context) const;
  Prescribed prescribed(const BoundDesign& design, MotionKind kind) const;
  Constrained constrained_at(std::span<const double> variables, const RunContext& context) const;
  /// out[c][16] = values of a solution at a tile of the following points.
  void fill_tile(const Solution& solution, std::size_t tile, double* out) const;
  void add_fields(PointId id, const Vec3& cotangent, std::vector<double>& fields) const;
  std::vector<double> contract_fields(const Eigen::MatrixXd& back) const;

  const EnergyOptions options_;
  EnergyModel model_;
  std::unique_ptr<const EnergySolver> solver_;
  std::unique_ptr<const ResidualCorrection> correction_;  ///< null for the shell and soft handles
  std::unique_ptr<const ConstrainedSolver> constrained_;  ///< null without constraints
  std::vector<std::size_t> constraint_of_;                ///< per set
  TiledPoints set_places_;                                ///< of the points of the sets; only with a correction or exact ones
  std::unique_ptr<const ExactStep> exact_;                ///< null without exact constraints
  std::vector<std::uint32_t> samples_;                    ///< of the following points, where errors are measured
  double linear_error_ = 0;                               ///< of solutions, relative to the motion; with constraints
  TiledPoints following_places_;                          ///< unit coordinates; only with a correction or exact constraints
};

}  // namespace deform
