#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "core/deformers/constrained/constrained_solver.h"
#include "core/deformers/constrained/energy_solver.h"
#include "core/deformers/constrained/exact_placement.h"
#include "core/deformers/energy/residual_correction.h"
#include "core/deformers/energy/spaces/shell.h"
#include "core/deformers/handles/field_tiles.h"
#include "core/deformers/handles/handle_motion.h"
#include "core/deformers/system.h"

namespace deform {

struct ConstraintSets;

/// What the options of all energy methods have in common.
struct EnergyOptions {
  HandleMode handles = HandleMode::hard;
  double fixing = 1000;
  BasisMode basis = BasisMode::automatic;
};
EnergyOptions energy_options(const Setup& setup);

/// The space of a method other than RBF and its held points.
EnergyModel energy_model(const Mesh& mesh, const Setup& setup, const std::vector<RegionIndex>& region_of, const UnitBox& box,
                         const RunContext& context);

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
///    deformation.
///  - Exact constraints: their points end where ExactPlacement puts them; how far that moves them is interpolated (triharmonic,
///    zero at held points) and added everywhere. Where that makes the deformation worse it is left out
///    (ConstraintReport::given_up), for single sets or altogether; derivatives then leave it out as well.
/// Coincident held points may go to different places with the shell (a crack opens), not with the others.
class EnergySystem : public System {
 public:
  EnergySystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const RunContext& context, std::size_t memory_budget);

  const SystemInfo& info() const override { return info_; }
  std::unique_ptr<const Evaluation> bind(std::span<const Design> designs, EvaluationPath path,
                                         const RunContext& context) const override;
  std::unique_ptr<const Evaluation> bind_sequence(std::span<const Design> designs, EvaluationPath path, WarmStart& warm,
                                                  const RunContext& context) const override;
  Points jacobian_vector(std::span<const double> variables, std::span<const double> direction,
                         const RunContext& context) const override;
  std::vector<double> vector_jacobian(std::span<const double> variables, const Points& cotangent,
                                      const RunContext& context) const override;

 private:
  friend class EnergyEvaluation;
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

  /// Fields over the whole mesh, in the units of what they were made from.
  struct Solution {
    RowMajor w;                      ///< k x c
    RowMajor correction;             ///< rows x c, or empty
    RowMajor placement;              ///< of the correction towards exact points: rows x 3; empty when there is no such step
    ExactPlacement::Placed exact;    ///< where these are, unit coordinates
    std::vector<Vec3> exact_values;  ///< what they get: positions, or their derivatives, model units; empty as well
    std::vector<double> misfits;     ///< c: largest |value - prescribed| at the samples of the held points
  };

  /// Prescribed displacements or their derivatives, in units of D.
  struct Prescribed {
    Eigen::MatrixXd h;          ///< m x 3, of the held points that count
    std::vector<Vec3> offsets;  ///< of the points of the constraints that no function reaches, zero for the others
  };

  HeldPoints held() const { return {*mesh_, setup_, regions_, region_of_, rank_of_, coincident_, info_.diagonal}; }
  void place_points();
  void prepare_solver(const RunContext& context, std::size_t memory_budget);
  void prepare_constraints(ConstraintSets constraints, const RunContext& context, std::size_t memory_budget);
  void prepare_exact(const std::vector<ConstraintSet>& sets, const RunContext& context);
  void prepare_basis(const RunContext& context, std::size_t memory_budget);
  void fill_info();
  std::vector<Vec3> unit_places(const std::vector<PointId>& ids) const;
  Eigen::MatrixXd handle_fields(std::size_t handle) const;
  Solution solve(const Eigen::MatrixXd& h, const RunContext& context) const;
  Eigen::MatrixXd misfit(const Eigen::MatrixXd& h, const Eigen::MatrixXd& w) const;
  void measure(const Eigen::MatrixXd& h, Solution& solution) const;
  Solution completed(const Eigen::MatrixXd& h, const Eigen::MatrixXd& w, const RunContext& context) const;
  Prescribed prescribed(const BoundDesign& design, MotionKind kind) const;
  /// A constrained design and where its exact points are.
  struct Constrained {
    ConstrainedResult result;
    ExactPlacement::Placed exact;
  };
  Constrained constrained_at(std::span<const double> variables, const RunContext& context) const;
  std::vector<Vec3> before_exact(const Solution& solution, const BoundDesign& design, MotionKind kind) const;
  void place_exactly(const BoundDesign& design, Solution& solution, const RunContext& context) const;
  bool carries_far(const Solution& solution, const RunContext& context) const;
  void derive_exactly(const ExactPlacement::Placed& at, const BoundDesign& design, Solution& solution,
                      const RunContext& context) const;
  void set_placement(const std::vector<Vec3>& from, const std::vector<Vec3>& to, Solution& solution,
                     const RunContext& context) const;
  std::vector<Vec3> pull_back_exact(const ExactPlacement::Placed& at, std::vector<Vec3>& cotangents,
                                    const RunContext& context) const;
  /// out[c][16] = values of a solution at a tile of the following points.
  void fill_tile(const Solution& solution, std::size_t tile, double* out) const;
  std::vector<double> pull_back(std::span<const double> variables, const Points& cotangent, const RunContext& context) const;
  void add_fields(PointId id, const Vec3& cotangent, std::vector<double>& fields) const;
  std::vector<double> contract_fields(const Eigen::MatrixXd& back) const;
  bool exact() const { return options_.handles == HandleMode::hard; }

  std::shared_ptr<const Mesh> mesh_;
  Setup setup_;
  EnergyOptions options_;
  SelectedRegions regions_;
  std::vector<RegionIndex> region_of_;            ///< n
  std::vector<std::uint32_t> rank_of_;            ///< n: position of a handle point among the points of its handle
  std::vector<std::vector<PointId>> coincident_;  ///< held points; empty for the shell
  UnitBox box_;                                   ///< its scale is D
  std::vector<HandleFrame> frames_;
  EnergyModel model_;
  std::unique_ptr<const EnergySolver> solver_;
  std::unique_ptr<const ResidualCorrection> correction_;            ///< null for the shell and soft handles
  std::unique_ptr<const ConstrainedSolver> constrained_;            ///< null without constraints
  std::vector<std::size_t> constraint_of_;                          ///< per set
  TiledPoints set_places_;                                          ///< of the points of the sets; only with a correction
  std::unique_ptr<const ExactPlacement> placement_;                 ///< null without exact constraints
  std::unique_ptr<const ResidualCorrection> placement_correction_;  ///< of its points that move, then of the held ones
  std::vector<std::size_t> exact_constraint_of_;                    ///< per set of placement_
  std::vector<std::uint32_t> moving_exact_;                         ///< these points among those of placement_
  TiledPoints exact_places_;                                        ///< of all points of placement_
  std::vector<PointId> following_;                                  ///< ascending: points that the solution moves
  TiledPoints following_places_;                                    ///< unit coordinates; only with a correction of either kind
  std::unique_ptr<const FieldTiles> basis_;                         ///< null without one
  std::vector<double> basis_misfits_;                               ///< per field
  SystemInfo info_;
};

/// Constraints count with what their points at rest say, and with one design that is solved for (peak_bytes). Throws what
/// validate() and constraint_sets() throw.
Estimate estimate_energy(const Mesh& mesh, const Setup& setup);

}  // namespace deform
