// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "core/deformers/composed/composed_setup.h"
#include "core/deformers/setup.h"
#include "core/deformers/system.h"

namespace deform {

/// Several methods, one after the other (Setup::then): y_s(x) = y_{s-1}(x) + u_s(x), y_{-1}(x) = x. Each method is prepared for
/// the points at rest, so there is one factorization of each, whatever the design. Its data start where the methods before it
/// end: u_s interpolates M(y_{s-1}(x)) - y_{s-1}(x) at the points of a handle with the motion M, and zero at its fixed points.
/// So handle points go to M(y_{s-1}) and fixed points stay at y_{s-1}, as if the result of the methods before were deformed by a
/// setup of its own; between them, distances are those of the points at rest.
///
/// Where the data are affine motions of the points at rest, because M translates or the points have not moved, the methods are
/// independent: their bases, fields and adjoints apply. Otherwise a design prescribes displacements point by point, which takes
/// the direct path, and products with the transposed Jacobian take one solution for each variable. Control points have no
/// y_{s-1}: handles that select them move them from rest.
///
/// DesignReport::prescribed_displacement is that of the chain: the largest distance from rest of a place to which a method sends
/// a point of a handle that moves. A point that several methods move counts with the last of these; where methods move on what
/// they do not hold, the place that was prescribed counts. A control point counts with its own displacement after that of a point
/// of the mesh near it.
class ComposedSystem : public System {
 public:
  /// Where the control points of a setup of one method are at rest, model units: control_places() of all methods.
  using ControlPlaces = std::function<std::vector<Vec3>(const Setup&, const Mesh&, const Symmetry&)>;
  /// Throws what prepare() throws for each method, naming then[i].
  ComposedSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const RunContext& context, std::size_t memory_budget,
                 const ControlPlaces& control_places);

  const SystemInfo& info() const override { return info_; }
  std::unique_ptr<const Evaluation> bind(std::span<const Design> designs, EvaluationPath path,
                                         const RunContext& context) const override;
  /// Throws Error(failed_precondition) if any of the methods is defined at the points of the mesh only.
  std::unique_ptr<const SpaceMap> bind_in_space(const Design& design, const RunContext& context) const override;
  SpaceBytes space_bytes(std::size_t points) const override;
  Points jacobian_vector(std::span<const double> variables, std::span<const double> direction,
                         const RunContext& context) const override;
  std::vector<double> vector_jacobian(std::span<const double> variables, const Points& cotangent,
                                      const RunContext& context) const override;
  std::vector<std::vector<double>> vector_jacobians(std::span<const double> variables, std::span<const Points> cotangents,
                                                    const RunContext& context) const override;
  std::unique_ptr<const DisplacementFields> displacement_fields() const override;

  std::size_t stages() const { return stages_.size(); }                            ///< how many methods
  const System& stage(std::size_t index) const { return *stages_[index].system; }  ///< the system of one of them

 private:
  friend class ComposedEvaluation;
  friend class ComposedMap;

  struct Prepared {
    StageSetup of;
    std::shared_ptr<const System> system;
    /// For each handle, if they select control points and there are methods before: where these are at rest, and a point of the
    /// mesh near each.
    std::vector<std::vector<Vec3>> controls{};
    std::vector<std::vector<PointId>> near{};
  };
  /// The designs of each method, and their evaluations.
  struct Bound {
    std::vector<std::vector<Design>> designs;
    std::vector<std::unique_ptr<const Evaluation>> evaluations;
    std::vector<std::vector<Affine>> maps;  ///< of all handles, for each design
    std::vector<DesignReport> reports;      ///< of the composed designs
  };
  /// A handle whose points have moved before its motion turns or scales them.
  struct Turned {
    std::size_t handle = 0;  ///< of the whole setup
    Affine map{};            ///< its motion
    std::vector<Vec3> at;    ///< its points as the methods before leave them
  };

  void fill_info();
  void add_stage_info(std::size_t stage);
  void find_near_points(std::size_t stage, const ControlPlaces& control_places);
  /// Binds the first `stages` methods.
  Bound bind_stages(std::span<const Design> designs, std::size_t stages, EvaluationPath path, const RunContext& context) const;
  /// The design of one method; the methods before it are bound.
  Design stage_design(const Design& design, std::size_t index, std::size_t stage, const Bound& before, EvaluationPath path,
                      const RunContext& context) const;
  std::vector<Affine> checked_maps(const Design& design, std::size_t index) const;
  void add_report(const Bound& bound, std::size_t stage, std::size_t index, DesignReport& report) const;
  /// The largest displacement that a design prescribes for a handle point, see above. All methods are bound.
  double prescribed_displacement(const Bound& bound, const Design& design, std::size_t index, const RunContext& context) const;
  double control_displacement(const Bound& bound, std::size_t index, std::size_t stage, std::size_t handle, const Motion& motion,
                              const RunContext& context) const;
  /// Points of a design after the first `stages` methods, which are bound.
  std::vector<Vec3> places(const Bound& bound, std::size_t stages, std::size_t design, std::span<const PointId> ids,
                           const RunContext& context) const;
  /// For each method the handles at which its data depend on the points before it, or whose motion changes so, at `variables`.
  std::vector<std::vector<Turned>> turned_at(std::span<const double> variables, const RunContext& context) const;
  Points product(std::span<const double> variables, std::span<const double> direction,
                 const std::vector<std::vector<Turned>>& turned, const RunContext& context) const;
  /// What a method with such handles adds to the derivative `before` of the points before it.
  Points turned_product(std::size_t stage, const std::vector<Affine>& rates, const std::vector<Turned>& turned,
                        const Points& before, const RunContext& context) const;

  const std::shared_ptr<const Mesh> mesh_;
  const Setup setup_;
  const SelectedRegions regions_;
  std::vector<Prepared> stages_;
  SystemInfo info_;
};

}  // namespace deform
