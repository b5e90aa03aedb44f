#pragma once

#include <memory>
#include <vector>

#include "core/deformers/rbf/rbf_system.h"

namespace deform {

/// Designs bound to an RbfSystem. Columns of a part's coefficient matrices belong to designs, one for each of its components.
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
  void check_tolerance(std::size_t index) const;
  void check_sliding(std::size_t index) const;
  Vec3 prescribed(const BoundDesign& design, PointId id) const;
  void choose_paths(EvaluationPath path);
  void solve(const RunContext& context);
  void set_basis_coefficients();
  void solve_direct(const RunContext& context);
  void solve_to_tolerance(const RunContext& context);
  Eigen::MatrixXd part_data(const BoundDesign& design, const RbfPart& part) const;
  void measure_direct();
  void evaluate_constrained(std::size_t begin, std::size_t end, std::size_t first, std::span<Vec3* const> out) const;
  void evaluate_deformable(std::size_t begin, std::size_t end, std::size_t first, std::span<Vec3* const> out) const;
  void fill_tile(std::size_t tile, std::size_t first, std::size_t count, double* values) const;
  void part_tile(std::size_t part, std::size_t tile, std::size_t first, std::size_t count, double* values) const;

  /// Of one part; each design has as many columns as the part has components.
  struct Coefficients {
    std::vector<double> basis;   ///< 4H x columns, row by row
    std::vector<double> direct;  ///< (m + q) x columns, row by row
    /// Iterative: values at the deformable points of the designs that go through direct solution, d x components each. Their
    /// fast sums have a global part, so they are computed as a whole.
    std::vector<std::vector<double>> values;
  };

  std::shared_ptr<const RbfSystem> system_;
  HeldPoints held_;  ///< of the system
  MotionKind kind_ = MotionKind::position;
  std::vector<BoundDesign> designs_;
  std::vector<DesignReport> reports_;
  std::vector<std::size_t> slot_;  ///< of each design among those of its path
  std::size_t basis_designs_ = 0, direct_designs_ = 0;
  std::vector<Coefficients> coefficients_;  ///< per part of the system
};

}  // namespace deform
