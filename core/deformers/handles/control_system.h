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

namespace deform {

/// Control points and what they do to a mesh: a point goes by the sum of their displacements times their functions there.
struct ControlModel {
  std::shared_ptr<const Mesh> controls;          ///< its points: where the control points are, k
  std::shared_ptr<const ControlFunctions> rows;  ///< functions of the control points at the points of the mesh, n x k; 0 outside
  std::vector<std::string> notes;
  std::vector<std::uint32_t> outside;  ///< points that no function reaches, ascending
  std::shared_ptr<const ControlFunctions>
      crossings;  ///< the functions where edges of the mesh leave what they reach; null: nowhere
  /// Which points a function reaches.
  enum class Reach { some, everywhere };
  Reach reach = Reach::some;
  /// Rounding of a sum, of the largest displacement of a control point; by default of functions that are not negative and add up
  /// to 1.
  double rounding = 5e-14;
  double seconds_per_row = 0;  ///< that the functions at a point take; 0: in proportion to their number
};

/// Handles move control points, the others stay, and all points of the mesh follow (classical free-form deformation, thesis 3.2).
/// The handle basis, its derivatives and populations are those of HandleSystem; without a basis a design is one sum per point.
class ControlSystem : public HandleSystem {
 public:
  /// options: of the basis only. Throws what HandleSystem throws.
  ControlSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, ControlModel model, const EnergyOptions& options,
                const RunContext& context);

  std::unique_ptr<const Evaluation> bind(std::span<const Design> designs, EvaluationPath path,
                                         const RunContext& context) const override;

 private:
  friend class ControlEvaluation;

  std::unique_ptr<const Evaluation> derivative(std::span<const double> variables, const std::vector<Affine>& maps,
                                               const RunContext& context) const override;
  std::vector<double> adjoint(std::span<const double> variables, const std::vector<Vec3>& at_following,
                              const RunContext& context) const override;
  void prepare_basis(const EnergyOptions& options, const RunContext& context);
  void fill_info();
  /// Names of the handles that reach no point of the mesh.
  std::vector<std::string> idle_handles(const RunContext& context) const;
  bool moves(std::size_t control) const { return points_.region_of[control] < fixed_region; }
  /// Of those of the handle of a control point that moves().
  std::size_t first_field(std::size_t control) const { return std::size_t{4} * points_.region_of[control]; }
  /// Displacements of the control points: k.
  std::vector<Vec3> displacements(const BoundDesign& design, MotionKind kind) const;

  const ControlModel model_;
  std::vector<std::array<double, 4>> fields_;  ///< k: the fields of its handle at a control point, unit coordinates
  std::vector<std::string> idle_;
};

/// What to expect of one, before anything is computed; `rows` and `notes` of the model count.
Estimate estimate_controls(const Mesh& mesh, const ControlModel& model, const EnergyOptions& options,
                           const SelectedRegions& regions);

}  // namespace deform
