// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/deformers/constrained/constraint_sets.h"
#include "core/deformers/constrained/exact_placement.h"
#include "core/deformers/energy/residual_correction.h"
#include "core/deformers/handles/handle_motion.h"
#include "core/numerics/sparse/sparse.h"

namespace deform {

using RowMajorMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// A displacement field over the mesh, in the units of what it was made from.
struct EnergyField {
  RowMajorMatrix w;           ///< k x c: coefficients of the functions
  RowMajorMatrix correction;  ///< of the ResidualCorrection: rows x c, or empty
};

/// The deformation that an exact step starts from; everything is borrowed from its system.
struct DeformationBefore {
  HeldPoints held;
  const UnitBox& box;
  const std::vector<PointId>& held_ids;  ///< those that enter the system
  const std::vector<PointId>& following;
  const TiledPoints& following_places;  ///< unit coordinates
  const FunctionRows values;            ///< of the functions at all points
  const ResidualCorrection* correction;
  bool hard_handles;
};

/// The last step of a design with exact constraints, and its derivatives: ExactPlacement puts their points on the shapes; how far
/// that moves them is interpolated (zero at held points) and added to all points that follow. Where that makes the deformation
/// worse it is left out, for single sets or altogether. Immutable; any thread.
class ExactStep {
 public:
  /// Takes the sets of exact constraints; constraint_of: per set. What `before` refers to must outlive this.
  ExactStep(const DeformationBefore& before, const std::vector<ConstraintSet>& sets,
            const std::vector<std::size_t>& constraint_of, const RunContext& context);

  /// The step of one design or derivative.
  struct Step {
    ExactPlacement::Placed placed;  ///< unit coordinates
    RowMajorMatrix carried;         ///< coefficients of the field that is added: rows x 3, or empty
    std::vector<Vec3> values;       ///< what the points get: positions or their derivatives, model units; empty as well
  };
  Step place(const EnergyField& field, const BoundDesign& design, const RunContext& context) const;
  Step derivative(const ExactPlacement::Placed& at, const EnergyField& field, const BoundDesign& design,
                  const RunContext& context) const;
  /// Cotangents of the following points become those of the deformation before the step; the result is what arrives at ids().
  std::vector<Vec3> adjoint(const ExactPlacement::Placed& at, std::vector<Vec3>& cotangents, const RunContext& context) const;

  /// Adds the field of a step at a tile of points: out[component][16].
  void add_values(const double* tile, const Step& step, double* out) const;
  /// The points of all sets, ascending, and whether the step may move one.
  const std::vector<PointId>& ids() const { return placement_->ids(); }
  bool moves(std::size_t u) const { return placement_->moves(u); }
  /// Of each set: its constraint in the setup.
  const std::vector<std::size_t>& constraint_of() const { return constraint_of_; }
  std::size_t bytes() const { return placement_->bytes() + carrier_->bytes() + places_.bytes(); }

 private:
  std::vector<Vec3> points_before(const EnergyField& field, const BoundDesign& design, MotionKind kind) const;
  RowMajorMatrix carried(const std::vector<Vec3>& from, const std::vector<Vec3>& to, const RunContext& context) const;
  bool carries_far(const Step& step, const RunContext& context) const;

  const DeformationBefore before_;
  std::vector<std::size_t> constraint_of_;
  std::unique_ptr<const ExactPlacement> placement_;
  std::unique_ptr<const ResidualCorrection> carrier_;  ///< of the points that move, then of the held ones
  std::vector<std::uint32_t> moving_;                  ///< among ids()
  TiledPoints places_;                                 ///< of ids()
};

}  // namespace deform
