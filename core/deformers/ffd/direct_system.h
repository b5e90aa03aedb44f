// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/deformers/ffd/checked_rows.h"
#include "core/deformers/ffd/clamped_inverse.h"
#include "core/deformers/handles/control_functions.h"
#include "core/deformers/handles/handle_system.h"
#include "core/deformers/handles/space_functions.h"

namespace deform {

/// The control points of direct manipulation and its options.
struct DirectModel {
  std::shared_ptr<const ControlFunctions> rows;    ///< functions of the control points at the points of the mesh, n x k
  std::shared_ptr<const SpaceFunctions> in_space;  ///< the same at any place
  std::vector<std::string> notes;
  double clamp = 0;     ///< see ClampedInverse, or where it takes fewer functions DampedInverse
  double growth = 1;    ///< upper bound of the sum of the magnitudes of the values at a point
  double rounding = 0;  ///< standard deviation of the rounding errors of these values
  BasisMode basis = BasisMode::automatic;
  double basis_tolerance = 0;
  std::string remedy;  ///< shown in warnings about control points that move too far: "a larger clamp"
};
/// Creates the model from the regions of the points, which are not known before.
using MakeDirectModel = std::function<DirectModel(const std::vector<RegionIndex>& region_of)>;

/// Direct manipulation of a lattice or a cage (thesis 3.3): the control points move such that the handle and fixed points are
/// matched best, in the sense of ClampedInverse or DampedInverse. All points follow the control points, including those of
/// handles and fixed regions, which are matched only approximately: report().interpolation_residual is the largest misfit at any
/// of them. Points at which all functions are zero stay at rest.
class DirectSystem : public HandleSystem {
 public:
  /// Throws the errors of `make` and ClampedInverse.
  DirectSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const MakeDirectModel& make, const RunContext& context,
               std::size_t memory_budget);

  std::unique_ptr<const Evaluation> bind(std::span<const Design> designs, EvaluationPath path,
                                         const RunContext& context) const override;

 private:
  friend class DirectEvaluation;
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

  std::unique_ptr<const Evaluation> derivative(std::span<const double> variables, const std::vector<Affine>& maps,
                                               const RunContext& context) const override;
  Fields adjoint(std::span<const double> variables, Cotangents at_following, const RunContext& context) const override;
  std::string only_on_mesh() const override { return {}; }
  void prepare_basis(std::size_t memory_budget, const RunContext& context);
  void fill_info();
  /// The points at which errors are estimated.
  std::vector<PointId> checked_points() const;
  /// The fields 1, x, y, z of every handle at the held points, m x 4H, in unit coordinates.
  Eigen::MatrixXd fields_at_held() const;
  /// Sines and cosines along the axes at the held points, one turn over their longest extent, m x 6: what designs may contain
  /// besides affine motions.
  Eigen::MatrixXd waves_at_held() const;
  /// The prescribed displacements of the held points: m x 3, model units.
  Eigen::MatrixXd prescribed(const BoundDesign& design, MotionKind kind) const;
  /// The coefficients of the fields of the handles for a design of affine motions, 4H x 3, model units.
  Eigen::MatrixXd affine_coefficients(const BoundDesign& design, MotionKind kind) const;
  /// The misfit of a solution at the held points, prescribed minus actual: m x c.
  Eigen::MatrixXd misfit(const Eigen::MatrixXd& h, const Eigen::MatrixXd& controls) const;
  /// A solution as combinations of those of the fields of the handles, or by itself.
  struct Solved {
    Eigen::MatrixXd controls;  ///< k x c
    Eigen::MatrixXd missed;    ///< m x c
    Eigen::MatrixXd parts;     ///< HeldInverse::Solution::parts
    double largest_terms = 0;  ///< of the sums that prescribed displacements are
  };
  HeldInverse::Sizes sizes_of(const Solved& solved, Eigen::Index c) const;
  /// The estimated largest error of the field in column c of a solution at any point.
  double field_error(const Solved& solved, Eigen::Index c) const;
  /// The same of a design, the three components of which are the columns, model units.
  double error_of(const Solved& solved) const;
  /// Writes the values at a tile of the following points to out[c][16].
  void fill_tile(const RowMajor& controls, std::size_t tile, double* out) const;
  /// The displacements of a tile, 3 columns, for those of the control points, k x 3.
  void displace_tile(const RowMajor& controls, std::size_t tile, double* out) const;

  std::vector<PointId> ids_;  ///< m: handle and fixed points, ascending
  DirectModel model_;
  CheckedRows checked_;  ///< without the rows
  std::unique_ptr<const HeldInverse> inverse_;
  RowMajor controls_;       ///< k x 4H: displacements of the control points for the fields of the handles
  Eigen::MatrixXd missed_;  ///< m x 4H: what these fields are missed by at the held points; empty without a basis
  Eigen::MatrixXd parts_;   ///< s x 4H: HeldInverse::Solution::parts of these fields
};

/// The number of kinds of CheckedRows that a system has.
inline std::size_t checked_kinds(const Setup& setup) { return setup.images ? HeldInverse::most_kinds : 1; }

/// The input of estimate_direct().
struct DirectEstimate {
  HeldInverse::Bytes inverse;
  std::size_t held = 0, functions = 0;
  std::size_t row_bytes = 0;  ///< memory of the rows
  BasisMode basis = BasisMode::automatic;
  double basis_tolerance = 0;
  double seconds_per_row = 0;  ///< additional time to compute the functions at a point
};
/// Estimates the cost of a DirectSystem. Sets no advice.
Estimate estimate_direct(const Mesh& mesh, const SelectedRegions& regions, const DirectEstimate& of);

}  // namespace deform
