// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <vector>

#include "core/deformers/handles/control_system.h"
#include "core/deformers/handles/handle_evaluation.h"

namespace deform {

/// Designs bound to a ControlSystem.
class ControlEvaluation : public HandleEvaluation {
 public:
  ControlEvaluation(std::shared_ptr<const ControlSystem> system, std::span<const Design> designs, EvaluationPath path,
                    const RunContext& context);
  ControlEvaluation(std::shared_ptr<const ControlSystem> system, const std::vector<Affine>& derivatives,
                    const RunContext& context);

 private:
  void move_controls(const RunContext& context);
  void add_jump_warning(std::size_t design);
  void direct_tile(std::size_t tile, std::size_t first, std::size_t count, double* values) const override;
  void add_tile(std::size_t tile, std::size_t first, std::size_t count, double* values) const;
  SpaceMap::Found displacements_at(std::span<const Vec3> points, std::uint64_t first, std::span<Vec3> out,
                                   const RunContext& context) const override;

  /// Adds the displacements of places up over their images; returns how many places have no functions in any.
  std::size_t add_images(std::span<const Vec3> points, std::uint64_t first, std::span<Vec3> out) const;

  const ControlSystem& system_;
  std::vector<std::vector<Vec3>> controls_;  ///< displacements of the control points for each design on the direct path
};

}  // namespace deform
