// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/deformers/cage/green_system.h"
#include "core/deformers/handles/handle_evaluation.h"

namespace deform {

/// Designs bound to a GreenSystem.
class GreenEvaluation : public HandleEvaluation {
 public:
  GreenEvaluation(std::shared_ptr<const GreenSystem> system, std::span<const Design> designs, EvaluationPath path,
                  const RunContext& context);
  GreenEvaluation(std::shared_ptr<const GreenSystem> system, std::span<const double> variables,
                  const std::vector<Affine>& derivatives);

 private:
  /// Sets the rows of all vertices, and those of the parts of one vertex or triangle from `first` on; in the frame.
  void set_vertices(std::size_t design, std::span<const Vec3> displacements);
  void set_rows(std::size_t first, std::size_t design, const Vec3& value);
  void find_moving_rows();
  SpaceMap::Found displacements_at(std::span<const Vec3> points, std::uint64_t first, std::span<Vec3> out,
                                   const RunContext& context) const override;
  void direct_tile(std::size_t tile, std::size_t first, std::size_t count, double* values) const override;

  const GreenSystem& system_;
  std::vector<double> changes_;             ///< of vertices and normals: columns x (3 for each design), row-major
  std::vector<std::uint32_t> moving_rows_;  ///< with a nonzero value in any design, ascending
};

}  // namespace deform
