// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <vector>

#include "core/deformers/handles/handle_evaluation.h"
#include "core/deformers/rbf/rbf_system.h"
#include "core/numerics/interpolation/values_to_tolerance.h"

namespace deform {

/// Designs bound to an RbfSystem. Columns of a part's coefficient matrix belong to designs, one for each of its components.
class RbfEvaluation : public HandleEvaluation {
 public:
  RbfEvaluation(std::shared_ptr<const RbfSystem> system, std::span<const Design> designs, EvaluationPath path,
                const RunContext& context);
  RbfEvaluation(std::shared_ptr<const RbfSystem> system, const std::vector<Affine>& derivatives, const RunContext& context);

 private:
  void solve(const RunContext& context);
  void solve_exactly(const RunContext& context);
  void solve_to_tolerance(const RunContext& context);
  Eigen::MatrixXd part_data(const BoundDesign& design, const RbfPart& part) const;
  double part_error(std::size_t design, const RbfPart& part, const Interpolants& interpolants, const RunContext& context);
  void measure_residuals();
  void solve_derivative(const RunContext& context);
  void direct_tile(std::size_t tile, std::size_t first, std::size_t count, double* values) const override;
  SpaceMap::Found displacements_at(std::span<const Vec3> points, std::uint64_t first, std::span<Vec3> out,
                                   const RunContext& context) const override;
  /// Values of one part at places of the system's coordinates: n x components of the part, row by row.
  std::vector<double> part_values(std::size_t part, std::span<const Vec3> places, double& sums_error,
                                  const RunContext& context) const;
  void part_tile(std::size_t part, std::size_t tile, std::size_t first, std::size_t count, double* values) const;
  void turn_partners(std::size_t tile, std::size_t count, double* values) const;

  /// The solution of one part for the designs on the direct path. Each design has one column for each component of the part.
  struct Solution {
    std::vector<double> coefficients;  ///< (m + q) x columns, row by row
    /// For solvers that work to a tolerance: values at the deformable points, d x components for each design. They are computed
    /// for all points at once, because fast sums have a global part.
    std::vector<std::vector<double>> values;
    std::vector<SolvedValues> solved;  ///< what they are computed from
  };

  const RbfSystem& system_;
  std::vector<Solution> solutions_;  ///< one for each part of the system
};

}  // namespace deform
