// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "core/deformers/energy/energy_system.h"
#include "core/deformers/handles/handle_evaluation.h"

namespace deform {

/// Designs bound to an EnergySystem.
class EnergyEvaluation : public HandleEvaluation {
 public:
  /// `warm` is the start of the designs of bind_sequence(), or null.
  EnergyEvaluation(std::shared_ptr<const EnergySystem> system, std::span<const Design> designs, EvaluationPath path,
                   WarmStart* warm, const RunContext& context);
  /// The derivative at the solution `at`, for systems with constraints.
  EnergyEvaluation(std::shared_ptr<const EnergySystem> system, const std::vector<Affine>& derivatives,
                   const EnergySystem::Constrained& at, const RunContext& context);

 private:
  void solve(const RunContext& context);
  void solve_constrained(std::size_t design, WarmStart* warm, const RunContext& context);
  void report_misfit(std::size_t design);
  void measure_constraints(std::size_t design, const ConstrainedResult& result, const RunContext& context);
  void measure_held(const ConstraintSet& set, std::span<const Vec3> x, const ShapeParameters& shape, double prescribed,
                    ConstraintReport& report) const;
  void direct_tile(std::size_t tile, std::size_t first, std::size_t count, double* values) const override;
  SpaceMap::Found displacements_at(std::span<const Vec3> points, std::uint64_t first, std::span<Vec3> out,
                                   const RunContext& context) const override;
  std::vector<std::pair<PointId, Vec3>> replaced() const override;
  /// Replaces the points of exact constraints and of columns of cells.
  void replace_points(std::size_t begin, std::size_t end, std::size_t first, std::span<Vec3* const> out) const override;

  const EnergySystem& system_;
  std::vector<EnergySystem::Solution> solutions_;  ///< one for each design; empty on the basis path
};

}  // namespace deform
