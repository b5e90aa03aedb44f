// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <vector>

#include "core/deformers/ffd/direct_system.h"
#include "core/deformers/handles/handle_evaluation.h"

namespace deform {

/// Designs bound to a DirectSystem.
class DirectEvaluation : public HandleEvaluation {
 public:
  DirectEvaluation(std::shared_ptr<const DirectSystem> system, std::span<const Design> designs, EvaluationPath path,
                   const RunContext& context);
  DirectEvaluation(std::shared_ptr<const DirectSystem> system, const std::vector<Affine>& derivatives, const RunContext& context);

 private:
  void solve(const RunContext& context);
  void report_controls();
  void direct_tile(std::size_t tile, std::size_t first, std::size_t count, double* values) const override;
  SpaceMap::Found displacements_at(std::span<const Vec3> points, std::uint64_t first, std::span<Vec3> out,
                                   const RunContext& context) const override;

  const DirectSystem& system_;
  std::vector<DirectSystem::RowMajor> controls_;  ///< displacements of the control points for each design on the direct path
};

}  // namespace deform
