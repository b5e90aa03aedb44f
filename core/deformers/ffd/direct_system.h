// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/deformers/ffd/clamped_inverse.h"
#include "core/deformers/handles/handle_system.h"
#include "core/numerics/sparse/function_rows.h"

namespace deform {

/// What direct manipulation moves, and how.
struct DirectModel {
  std::shared_ptr<const ComputedRows> rows;  ///< functions of the control points at the points of the mesh, n x k
  std::vector<std::string> notes;
  double clamp = 0;   ///< see ClampedInverse
  double growth = 1;  ///< bound of the 2-norm of a row
  BasisMode basis = BasisMode::automatic;
  double basis_tolerance = 0;
  std::string remedy;  ///< what keeps control points back that move too far: "a larger clamp"
};
/// Of the regions of the points of the mesh, which are not known before.
using MakeDirectModel = std::function<DirectModel(const std::vector<RegionIndex>& region_of)>;

/// Direct manipulation of a lattice or a cage (thesis 3.3): the control points go where handles and fixed points are met best, in
/// the sense of ClampedInverse. All points follow the control points, those of handles and fixed regions too, so that they are
/// met as well as the control points can: report().interpolation_residual is the largest misfit at any of them (an upper bound on
/// the basis path). Points that no function reaches stay.
class DirectSystem : public HandleSystem {
 public:
  /// Throws what `make` and ClampedInverse throw.
  DirectSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const MakeDirectModel& make, const RunContext& context,
               std::size_t memory_budget);

  std::unique_ptr<const Evaluation> bind(std::span<const Design> designs, EvaluationPath path,
                                         const RunContext& context) const override;

 private:
  friend class DirectEvaluation;
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

  std::unique_ptr<const Evaluation> derivative(std::span<const double> variables, const std::vector<Affine>& maps,
                                               const RunContext& context) const override;
  std::vector<double> adjoint(std::span<const double> variables, const std::vector<Vec3>& at_following,
                              const RunContext& context) const override;
  void prepare_basis(std::size_t memory_budget, const RunContext& context);
  void fill_info();
  /// m x 4H: 1, x, y, z of every handle at the held points, in unit coordinates.
  Eigen::MatrixXd fields_at_held() const;
  /// Displacements of the held points: m x 3, model units.
  Eigen::MatrixXd prescribed(const BoundDesign& design, MotionKind kind) const;
  /// Displacements of the control points (k x 3, model units) in a design of affine motions, from controls_.
  RowMajor affine_controls(const BoundDesign& design, MotionKind kind) const;
  /// Misfits of a solution at the held points, m x c: prescribed minus reached.
  Eigen::MatrixXd misfit(const Eigen::MatrixXd& h, const Eigen::MatrixXd& controls) const;
  /// How far column c of a solution may be off at any point.
  double error_of(const Eigen::MatrixXd& controls, const Eigen::MatrixXd& missed, Eigen::Index c) const;
  /// out[c][16] = values at a tile of the following points.
  void fill_tile(const RowMajor& controls, std::size_t tile, double* out) const;

  std::vector<PointId> ids_;  ///< m: handle and fixed points, ascending
  DirectModel model_;
  std::unique_ptr<const ClampedInverse> inverse_;
  RowMajor controls_;  ///< k x 4H: the control points for the fields of the handles
};

/// What estimate_direct() counts from.
struct DirectEstimate {
  ClampedInverse::Bytes inverse;
  std::size_t held = 0, functions = 0;
  std::size_t row_bytes = 0;  ///< of the rows
  BasisMode basis = BasisMode::automatic;
  double basis_tolerance = 0;
  double seconds_per_row = 0;  ///< that the functions at a point take besides
};
/// Without advice.
Estimate estimate_direct(const Mesh& mesh, const SelectedRegions& regions, const DirectEstimate& of);

}  // namespace deform
