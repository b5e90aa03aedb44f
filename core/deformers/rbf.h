#pragma once

#include <memory>

#include "core/deformers/rbf_basis.h"
#include "core/deformers/rbf_centres.h"
#include "core/deformers/system.h"

namespace deform {

/// RBF space deformation (thesis 3.5, eq. 3.8 to 3.10) with the handle basis of thesis 4.2. Constraint points are set exactly
/// (affine image, displacement, rest); deformable points get the interpolant. What differs from System:
///  - report().interpolation_residual is an upper bound over all centres on the basis path and with solvers to a tolerance, and
///  the
///    largest value over at most 256 evenly spread centres on the direct path of the others. An iterative solution that did not
///    reach its tolerance shows there; notes tell of the basis only.
class RbfSystem : public System {
 public:
  RbfSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const RunContext& context, std::size_t memory_budget);

  const SystemInfo& info() const override { return info_; }
  std::unique_ptr<const Evaluation> bind(std::span<const Design> designs, EvaluationPath path,
                                         const RunContext& context) const override;
  Points jacobian_vector(std::span<const double> variables, std::span<const double> direction,
                         const RunContext& context) const override;
  std::vector<double> vector_jacobian(std::span<const double> variables, const Points& cotangent,
                                      const RunContext& context) const override;

 private:
  friend class RbfEvaluation;

  void add_notes(int degree);
  void prepare_basis(const RbfOptions& options, const RunContext& context);
  /// m x 4H: 1, x, y, z of every handle at the centres, in unit coordinates.
  Eigen::MatrixXd handle_fields(std::span<const Vec3> places) const;
  /// Adjoint of "handle fields to deformable points": 4H x 3 from a field (n x 3) of which the deformable points count.
  std::vector<double> pull_back(std::span<const Vec3> field, const RunContext& context) const;

  std::shared_ptr<const Mesh> mesh_;
  Setup setup_;
  SelectedRegions regions_;
  RbfCentres centres_;
  std::vector<std::uint32_t> rank_of_;  ///< n: position of a handle point among the points of its handle
  UnitBox box_;
  std::vector<HandleFrame> frames_;
  TiledPoints deformable_;  ///< unit coordinates
  std::unique_ptr<const InterpolationSystem> system_;
  std::unique_ptr<const HandleBasis> basis_;  ///< null without one
  SystemInfo info_;
};

Estimate estimate_rbf(const Mesh& mesh, const Setup& setup);

}  // namespace deform
