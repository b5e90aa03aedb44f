// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/deformers/handles/control_functions.h"
#include "core/deformers/handles/handle_system.h"
#include "core/deformers/handles/space_functions.h"

namespace deform {

/// Control points and their functions on a mesh: the displacement of a point is the sum of the displacements of the control
/// points times their functions at the point.
struct ControlModel {
  std::shared_ptr<const Mesh> controls;            ///< its points are the k control points
  std::shared_ptr<const ControlFunctions> rows;    ///< functions of the control points at the points of the mesh, n x k
  std::shared_ptr<const SpaceFunctions> in_space;  ///< the same at any place
  std::vector<std::string> notes;
  std::vector<std::uint32_t> outside;  ///< points at which all functions are zero, ascending
  /// The functions at places where edges of the mesh leave the support of all functions; null if there are none.
  std::shared_ptr<const ControlFunctions> crossings;
  /// Where the functions are nonzero.
  enum class Reach { some, everywhere };
  Reach reach = Reach::some;
  /// The rounding error of a sum, as a fraction of the largest displacement of a control point. The default is that of
  /// nonnegative functions that add up to 1.
  double rounding = 5e-14;
  double seconds_per_row = 0;  ///< time to compute the functions at a point; 0: proportional to their number
};

/// Handles move control points, the other control points stay, and all points of the mesh follow (classical free-form
/// deformation, thesis 3.2). The handle basis, its derivatives and populations are those of HandleSystem; without a basis,
/// evaluating a design takes one sum per point.
class ControlSystem : public HandleSystem {
 public:
  /// Only the basis options of `options` are used. Throws the errors of HandleSystem.
  ControlSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, ControlModel model, const EnergyOptions& options,
                const RunContext& context);

  std::unique_ptr<const Evaluation> bind(std::span<const Design> designs, EvaluationPath path,
                                         const RunContext& context) const override;

 private:
  friend class ControlEvaluation;

  std::unique_ptr<const Evaluation> derivative(std::span<const double> variables, const std::vector<Affine>& maps,
                                               const RunContext& context) const override;
  Fields adjoint(std::span<const double> variables, Cotangents at_following, const RunContext& context) const override;
  std::string only_on_mesh() const override { return {}; }
  void prepare_basis(const EnergyOptions& options, const RunContext& context);
  void fill_info();
  /// The names of handles whose control points have no influence on the mesh.
  std::vector<std::string> idle_handles(const RunContext& context) const;
  bool moves(std::size_t control) const { return points_.region_of[control] < fixed_region; }
  /// The first field of the handle of a control point that moves().
  std::size_t first_field(std::size_t control) const { return std::size_t{4} * points_.region_of[control]; }
  /// The displacements of the k control points.
  std::vector<Vec3> displacements(const BoundDesign& design, MotionKind kind) const;

  const ControlModel model_;
  std::vector<std::array<double, 4>> fields_;  ///< fields of its handle at each control point, unit coordinates
  std::vector<std::string> idle_;
};

/// Estimates the cost of a ControlSystem before anything is computed, from `rows` and `notes` of the model.
Estimate estimate_controls(const Mesh& mesh, const ControlModel& model, const EnergyOptions& options,
                           const SelectedRegions& regions);

}  // namespace deform
