// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <vector>

#include "core/deformers/handles/handle_system.h"
#include "core/deformers/rbf/rbf_parts.h"

namespace deform {

/// RBF space deformation (thesis 3.5, eq. 3.8 to 3.10) with the handle basis of thesis 4.2. Constraint points are set exactly
/// (affine image, displacement, rest); deformable points follow the interpolant. Differences from System:
///  - report().interpolation_residual is an upper bound over all centres on the basis path and for solvers that work to a
///    tolerance, otherwise the largest value over at most 256 evenly distributed centres;
///  - report().error and report().converged are set for solvers that work to a tolerance, see values_to_tolerance(). The
///    tolerance of the iterative solver bounds the error at the following points as a fraction of D, or of the largest prescribed
///    displacement if that is larger.
///
/// With symmetry planes or a sector the result is that of the whole model (one system per parity or harmonic, see PartPlan):
/// points on a plane slide and keep their distance from it. A motion that moves a handle point on a plane out of it by more than
/// its reach() is rejected, smaller normal components are dropped. The same holds for derivatives.
class RbfSystem : public HandleSystem {
 public:
  /// `options` must name a kernel.
  RbfSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const RbfOptions& options, const RunContext& context,
            std::size_t memory_budget);

  std::unique_ptr<const Evaluation> bind(std::span<const Design> designs, EvaluationPath path,
                                         const RunContext& context) const override;

 private:
  friend class RbfEvaluation;

  std::unique_ptr<const Evaluation> derivative(std::span<const double> variables, const std::vector<Affine>& maps,
                                               const RunContext& context) const override;
  Fields adjoint(std::span<const double> variables, Cotangents at_following, const RunContext& context) const override;
  /// Handle and fixed points that may become centres.
  std::vector<PointId> candidates() const;
  /// Sets misfit_ of centres that are not added to.
  void measure_misfit(const RunContext& context);
  /// Prepares parts, and adds centres at the largest misfits of the handle fields until the tolerance of the reduction is met.
  void refine_centres(const RunContext& context, std::size_t memory_budget);
  /// The same for misfits at some points, or at all of these, up to `limit` centres.
  enum class Look { at_some, at_all };
  void add_missed(const std::vector<PointId>& at, std::size_t limit, Look look, const RunContext& context,
                  std::size_t memory_budget);
  /// The misfits at constraint points: largest |interpolant - field| over the fields of all handles, as fractions of their
  /// largest values on the handle. On a handle that touches a symmetry plane only fields with the right parity count: even ones
  /// in the tangential components, the odd one in the normal component.
  std::vector<double> misfits(const std::vector<PointId>& ids, const RunContext& context) const;
  /// For each of the 4H fields one over its largest value, or 0 if it does not count for the part.
  std::vector<double> field_weights(const RbfPart& part) const;
  InterpolationOptions interpolation_options(const std::vector<Vec3>& places);
  void prepare_parts(const RunContext& context, std::size_t memory_budget);
  void prepare_basis(const RunContext& context);
  void turn_partners(std::vector<HandleBasis>& bases) const;
  void fill_info();
  void add_notes();
  /// The fields 1, x, y, z of every handle at the centres, m x 4H, in unit coordinates.
  Eigen::MatrixXd fields_at_centres() const;
  /// The displacements of the centres for each sample, divided by D, in the frame of the planes: m rows, 3 columns per sample.
  Eigen::MatrixXd sample_fields() const;
  void set_samples(InterpolationOptions& interpolation, const PartPlan& plan) const;
  Eigen::MatrixXd part_adjoint(const RbfPart& part, Cotangents at_deformable, const RunContext& context) const;
  Eigen::MatrixXd adjoint_by_fields(const RbfPart& part, Cotangents at_deformable, const RunContext& context) const;
  /// The coordinates in which the systems are solved: unit coordinates, in the frame of the symmetry planes if there are any.
  std::vector<Vec3> coordinates(const std::vector<PointId>& ids) const;
  /// The same of any place.
  Vec3 coordinates(const Vec3& place) const;
  std::string only_on_mesh() const override { return {}; }
  SpaceBytes space_bytes(std::size_t points) const override;

  const RbfOptions options_;
  RbfCentres centres_;
  TiledPoints deformable_;              ///< coordinates()
  std::vector<RbfPart> parts_;          ///< one without symmetry planes
  std::vector<std::uint32_t> checked_;  ///< positions in following() of the points at which errors are estimated
  std::vector<Vec3> checked_places_;    ///< coordinates() of these
  std::size_t factor_bytes_ = 0;
  std::size_t check_bytes_ = 0;  ///< memory of the error estimation
  double misfit_ = 0;            ///< see SystemInfo::reduction_misfit
  double relative_shape_ = 0;    ///< shape of the kernel, as a fraction of the diagonal of the centres
};

}  // namespace deform
