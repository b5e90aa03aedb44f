#pragma once

#include <memory>

#include "core/deformers/handles/constraint_points.h"
#include "core/deformers/handles/handle_basis.h"
#include "core/deformers/rbf/rbf_parts.h"
#include "core/deformers/system.h"

namespace deform {

/// RBF space deformation (thesis 3.5, eq. 3.8 to 3.10) with the handle basis of thesis 4.2. Constraint points are set exactly
/// (affine image, displacement, rest); deformable points get the interpolant. What differs from System:
///  - report().interpolation_residual is an upper bound over all centres on the basis path and with solvers to a tolerance, and
///  the
///    largest value over at most 256 evenly spread centres on the direct path of the others. An iterative solution that did not
///    reach its tolerance shows there; notes tell of the basis only.
///
/// With symmetry planes the result is that of the whole, mirrored model (one system per parity, see PartPlan): points on a plane
/// keep their distance from it and slide. A motion that sends a handle point on a plane out of it by more than its reach() is
/// refused, what is less is left out; so are derivatives with respect to variables that would.
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

  void place_points();
  InterpolationOptions interpolation_options(const std::vector<Vec3>& places);
  void prepare_parts(const RunContext& context, std::size_t memory_budget);
  void fill_info();
  void add_notes();
  void prepare_basis(const RunContext& context);
  /// m x 4H: 1, x, y, z of every handle at the centres, in unit coordinates.
  Eigen::MatrixXd handle_fields() const;
  /// m x 3 columns per sample: displacements of the centres over D, in the frame of the planes.
  Eigen::MatrixXd sample_fields() const;
  void set_samples(InterpolationOptions& interpolation, const PartPlan& plan) const;
  void check_sliding(const std::vector<Affine>& derivative, const std::string& what) const;
  std::vector<double> pull_back(const RbfPart& part, std::span<const Vec3> at_deformable, const RunContext& context) const;
  std::vector<double> pull_back(std::span<const Vec3> field, const RunContext& context) const;
  HeldPoints held() const {
    return {*mesh_, setup_, regions_, centres_.region_of, rank_of_, centres_.coincident, info_.diagonal};
  }
  bool has_basis() const { return !parts_.empty() && parts_.front().basis != nullptr; }

  /// Of a point, in what the systems are solved in: unit coordinates, in the frame of the planes when there are any.
  Vec3 coordinates(PointId id) const;
  /// Components of a displacement in the frame of the planes: those along the normals of planes that the point lies on are zero.
  Vec3 components(Vec3 in_frame, PointId id) const {
    const unsigned on = regions_.symmetry.on(id);
    for (std::size_t k = 0; k < 3; ++k) {
      if ((on >> k & 1u) != 0) in_frame[k] = 0;
    }
    return in_frame;
  }

  std::shared_ptr<const Mesh> mesh_;
  Setup setup_;
  SelectedRegions regions_;
  RbfCentres centres_;
  std::vector<std::uint32_t> rank_of_;  ///< n: position of a handle point among the points of its handle
  UnitBox box_;
  std::vector<HandleFrame> frames_;
  TiledPoints deformable_;        ///< coordinates()
  std::vector<PointId> sliding_;  ///< handle points on symmetry planes, ascending
  std::vector<RbfPart> parts_;    ///< one without symmetry planes
  double relative_shape_ = 0;     ///< of the kernel, as a fraction of the diagonal of the centres
  SystemInfo info_;
};

Estimate estimate_rbf(const Mesh& mesh, const Setup& setup);

}  // namespace deform
