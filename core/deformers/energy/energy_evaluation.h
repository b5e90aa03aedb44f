#pragma once

#include <memory>
#include <vector>

#include "core/deformers/energy/energy_system.h"

namespace deform {

/// Designs bound to an EnergySystem.
class EnergyEvaluation : public Evaluation {
 public:
  /// Positions for the designs of System::bind(), or of bind_sequence() with what they start from.
  EnergyEvaluation(std::shared_ptr<const EnergySystem> system, std::span<const Design> designs, EvaluationPath path,
                   WarmStart* warm, const RunContext& context);
  /// A displacement field from one affine map per handle (a derivative): evaluate() gives the field itself. With constraints the
  /// derivative at a solution.
  EnergyEvaluation(std::shared_ptr<const EnergySystem> system, const std::vector<Affine>& derivatives,
                   const EnergySystem::Constrained& at, const RunContext& context);

  std::size_t design_count() const override { return designs_.size(); }
  const DesignReport& report(std::size_t design) const override { return reports_[design]; }
  void evaluate(std::size_t begin, std::size_t end, std::size_t first, std::span<Vec3* const> out) const override;

 private:
  void choose_paths(EvaluationPath path);
  void set_basis_coefficients();
  void solve_direct(WarmStart* warm, const RunContext& context);
  void solve_constrained(std::size_t design, WarmStart* warm, const RunContext& context);
  std::vector<Vec3> final_points(std::size_t design, std::vector<Vec3> points) const;
  void measure_constraints(std::size_t design, const ConstrainedResult& result);
  void evaluate_following(std::size_t begin, std::size_t end, std::size_t first, std::span<Vec3* const> out) const;
  void evaluate_tile(std::size_t tile, std::size_t first, std::size_t count, double* values) const;

  std::shared_ptr<const EnergySystem> system_;
  HeldPoints held_;  ///< of the system
  MotionKind kind_ = MotionKind::position;
  std::vector<BoundDesign> designs_;
  std::vector<DesignReport> reports_;
  std::vector<std::size_t> slot_;  ///< of each design among those on the basis path
  std::size_t basis_designs_ = 0;
  std::vector<double> basis_;                      ///< 4H x 3 basis designs, row by row
  std::vector<EnergySystem::Solution> solutions_;  ///< per design; empty on the basis path
};

}  // namespace deform
