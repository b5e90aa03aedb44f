#pragma once

#include <memory>
#include <vector>

#include "core/deformers/rbf.h"

namespace deform {

/// What a design comes down to: per handle an affine map or displacements, borrowed from nobody.
struct BoundDesign {
  std::vector<Affine> affine;                   ///< H
  std::vector<std::vector<Vec3>> displacement;  ///< H, empty where the affine map holds
  bool is_affine() const;
};

/// Designs bound to an RbfSystem. Columns of the coefficient matrices belong to designs, three each.
class RbfEvaluation : public Evaluation {
 public:
  /// Positions for the designs of System::bind().
  RbfEvaluation(std::shared_ptr<const RbfSystem> system, std::span<const Design> designs, EvaluationPath path,
                const RunContext& context);
  /// A displacement field from one affine map per handle (a derivative): evaluate() gives the field itself.
  RbfEvaluation(std::shared_ptr<const RbfSystem> system, const std::vector<Affine>& derivatives, const RunContext& context);

  std::size_t design_count() const override { return designs_.size(); }
  const DesignReport& report(std::size_t design) const override { return reports_[design]; }
  void evaluate(std::size_t begin, std::size_t end, std::size_t first, std::span<Vec3* const> out) const override;

 private:
  BoundDesign bound(const Design& design, std::size_t index) const;
  void check_coincident(std::size_t index) const;
  Vec3 constrained(const BoundDesign& design, PointId id) const;
  void choose_paths(EvaluationPath path);
  void solve(const RunContext& context);
  void set_basis_coefficients();
  void solve_direct(const RunContext& context);
  void solve_to_tolerance(const RunContext& context);
  Eigen::MatrixXd prescribed(const BoundDesign& design) const;
  void measure_direct();
  void evaluate_constrained(std::size_t begin, std::size_t end, std::size_t first, std::span<Vec3* const> out) const;
  void evaluate_deformable(std::size_t begin, std::size_t end, std::size_t first, std::span<Vec3* const> out) const;

  std::shared_ptr<const RbfSystem> system_;
  MotionKind kind_ = MotionKind::position;
  std::vector<BoundDesign> designs_;
  std::vector<DesignReport> reports_;
  std::vector<std::size_t> column_;  ///< of each design in the matrix of its path
  std::size_t basis_columns_ = 0, direct_columns_ = 0;
  std::vector<double> basis_coefficients_;   ///< 4H x basis_columns_, row by row
  std::vector<double> direct_coefficients_;  ///< (m + q) x direct_columns_, row by row
  /// Solvers with a tolerance: values at the deformable points of the designs that go through direct solution, d x 3 each. Their
  /// fast sums have a global part, so they are computed as a whole.
  std::vector<std::vector<double>> direct_values_;
};

}  // namespace deform
