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

/// A displacement field over the mesh, in the units of the data from which it was computed.
struct EnergyField {
  RowMajorMatrix w;           ///< k x c: coefficients of the functions
  RowMajorMatrix correction;  ///< coefficients of the ResidualCorrection, rows x c, or empty
};

/// The deformation before an exact step; borrowed from the system.
struct DeformationBefore {
  HeldPoints held;
  const UnitBox& box;
  const std::vector<PointId>& held_ids;  ///< handle and fixed points that enter the system
  const std::vector<PointId>& following;
  const TiledPoints& following_places;  ///< unit coordinates
  const FunctionRows values;            ///< values of the functions at all points
  const ResidualCorrection* correction;
  bool hard_handles;
};

/// The places between which the steps of exact points are interpolated.
struct CarrierPlaces {
  std::vector<Vec3> places;            ///< unit coordinates: of the exact points that move, then of handle and fixed points
  std::vector<std::uint32_t> centres;  ///< positions among the places
  std::vector<char> bound;  ///< of each place whether it is met even if it is no centre; empty with ExactSteps::centres
};

/// What they are chosen from.
struct CarrierInput {
  const Mesh& mesh;
  const UnitBox& box;
  const std::vector<RegionIndex>& region_of;
  const std::vector<PointId>& moving;  ///< exact points that move, ascending
  const std::vector<PointId>& held;    ///< handle and fixed points that enter the system
  std::size_t following;               ///< number of following points
  ExactSteps steps;
};
CarrierPlaces carrier_places(const CarrierInput& from);

/// The last step of a design with exact constraints, and its derivatives: ExactPlacement moves their points onto the shapes, and
/// these displacements are interpolated (zero at handle and fixed points; see ExactSteps for where) and added at all following
/// points. The step is omitted, for single sets or as a whole, if it would make the deformation worse. Immutable; any thread.
class ExactStep {
 public:
  /// Uses the sets of exact constraints; `constraint_of` holds the constraint of each set. The objects that `before` refers to
  /// must outlive this object.
  ExactStep(const DeformationBefore& before, const std::vector<ConstraintSet>& sets,
            const std::vector<std::size_t>& constraint_of, const RunContext& context);

  /// The step of one design or derivative.
  struct Step {
    ExactPlacement::Placed placed;  ///< unit coordinates
    RowMajorMatrix carried;         ///< coefficients of the added field, rows x 3, or empty
    std::vector<Vec3> values;       ///< resulting positions or their derivatives, model units; may be empty too
  };
  /// `shapes` are those of all sets, fitted to the points before the step.
  Step place(const EnergyField& field, const BoundDesign& design, const std::vector<ShapeParameters>& shapes,
             const RunContext& context) const;
  Step derivative(const ExactPlacement::Placed& at, const EnergyField& field, const BoundDesign& design,
                  const RunContext& context) const;
  /// Replaces cotangents of the following points by those of the deformation before the step, and returns the cotangents
  /// at ids().
  std::vector<Vec3> adjoint(const ExactPlacement::Placed& at, std::vector<Vec3>& cotangents, const RunContext& context) const;

  /// Adds the field of a step at a tile of points: out[component][16].
  void add_values(const double* tile, const Step& step, double* out) const;
  /// The points of all sets, ascending, and whether the step may move one.
  const std::vector<PointId>& ids() const { return placement_->ids(); }
  bool moves(std::size_t u) const { return placement_->moves(u); }
  /// The constraint of each set, as its position in the setup.
  const std::vector<std::size_t>& constraint_of() const { return constraint_of_; }
  std::size_t bytes() const { return placement_->bytes() + carrier_->bytes() + places_.bytes(); }

 private:
  std::vector<Vec3> points_before(const EnergyField& field, const BoundDesign& design, MotionKind kind) const;
  RowMajorMatrix carried(const std::vector<Vec3>& from, const std::vector<Vec3>& to, const RunContext& context) const;
  bool carries_far(const Step& step, const RunContext& context) const;

  const DeformationBefore before_;
  std::vector<std::size_t> set_of_;  ///< number of each exact set among all sets
  std::vector<std::size_t> constraint_of_;
  std::unique_ptr<const ExactPlacement> placement_;
  std::unique_ptr<const ResidualCorrection> carrier_;  ///< see CarrierPlaces
  std::size_t carried_from_ = 0;                       ///< number of places of the carrier
  std::vector<std::uint32_t> moving_;                  ///< positions in ids()
  TiledPoints places_;                                 ///< points of ids()
};

}  // namespace deform
