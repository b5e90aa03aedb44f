// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/base/stopwatch.h"
#include "core/deformers/handles/constraint_points.h"
#include "core/deformers/handles/handle_basis.h"
#include "core/deformers/handles/handle_motion.h"
#include "core/deformers/system.h"

namespace deform {

/// A system that is driven by handles: the regions of a setup on a mesh, what their motions come to, the handle basis and the
/// chain rule from the points to the design variables. A method derives from it and from HandleEvaluation and supplies its
/// solution: see tests/support/uniform_blend.h for a small one.
///
/// Points that are prescribed (handles and fixed regions, unless these are soft) go exactly where they are sent; the others
/// follow the solution. With symmetry planes the displacements of the following points are handled in the frame of the planes,
/// where a component along the normal of a plane is zero at its points.
class HandleSystem : public System {
 public:
  const SystemInfo& info() const final { return info_; }
  Points jacobian_vector(std::span<const double> variables, std::span<const double> direction,
                         const RunContext& context) const final;
  std::vector<double> vector_jacobian(std::span<const double> variables, const Points& cotangent,
                                      const RunContext& context) const final;

 protected:
  friend class HandleEvaluation;
  friend class CompiledForm;

  /// How long a unit of the solution's coordinates is.
  enum class Unit { longest_edge, diagonal };
  HandleSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, HandleMode handles, Unit unit, const RunContext& context);
  /// Handles and fixed regions select control points (SelectedRegions::of), whose places are the points of `controls`; all points
  /// of the mesh follow. Units are those of the diagonal of the mesh.
  HandleSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, std::shared_ptr<const Mesh> controls,
               const RunContext& context);

  /// The derivative of a deformation at `variables`, where the handles change as the maps say: a displacement field.
  virtual std::unique_ptr<const Evaluation> derivative(std::span<const double> variables, const std::vector<Affine>& maps,
                                                       const RunContext& context) const = 0;
  /// The transpose of "fields of the handles to displacements of the following points" (in the frame of the planes) without a
  /// basis: 4H x 3, row by row, from one vector per following point.
  virtual std::vector<double> adjoint(std::span<const double> variables, const std::vector<Vec3>& at_following,
                                      const RunContext& context) const = 0;

  /// Whether handle and fixed points are prescribed.
  bool hard_handles() const { return handles_ == HandleMode::hard; }
  bool is_prescribed(PointId id) const { return hard_handles() && points_.region_of[id] != deformable_region; }
  /// Points that follow the solution, ascending.
  const std::vector<PointId>& following() const { return hard_handles() ? points_.deformable : all_; }
  bool has_basis() const { return !basis_.empty(); }
  std::size_t fields() const { return 4 * frames_.size(); }
  HeldPoints held() const {
    return {*held_mesh_, setup_, regions_, points_.region_of, rank_of_, points_.coincident, info_.diagonal};
  }
  /// 1, x, y, z of a handle at one of its points: unit coordinates, from its point of reference.
  std::array<double, 4> handle_fields(std::size_t handle, PointId id) const;
  /// A displacement in the frame of the planes, without its components along the normals of those that the point lies on.
  Vec3 components(Vec3 in_frame, PointId id) const;
  /// Refuses what System::bind() says: tolerances, coincident points that part, points that leave their symmetry plane.
  void check(const BoundDesign& design, std::size_t index) const;
  /// Unit coordinates of the points that follow.
  std::vector<Vec3> following_places() const { return unit_places(*mesh_, box_, following()); }
  /// Stores a basis, to a tolerance (see HandleBasis::compress()) or, with 0, as
  /// it is.
  void add_basis(HandleBasis&& basis, double tolerance, const RunContext& context);
  /// Ends a stage of preparing: its seconds in info().
  void end_stage(const char* name) { info_.stage_seconds.emplace_back(name, watch_.lap()); }
  /// Bytes and basis in info(); `more` bytes are neither of the factor nor of the basis.
  void set_bytes(std::size_t factor_bytes, std::size_t more);

  const std::shared_ptr<const Mesh> mesh_;
  const std::shared_ptr<const Mesh> held_mesh_;  ///< of the points of handles and fixed regions: the mesh, or control points
  const Setup setup_;
  SelectedRegions regions_;
  ConstraintPoints points_;             ///< of held_mesh_
  std::vector<std::uint32_t> rank_of_;  ///< per point of held_mesh_: position of a handle point among the points of its handle
  UnitBox box_;
  std::vector<HandleFrame> frames_;
  std::vector<HandleBasis> basis_;  ///< of different components; empty: none is stored
  SystemInfo info_;

 private:
  struct Held;
  HandleSystem(Held held, const Setup& setup, HandleMode handles, Unit unit, const RunContext& context);
  void check_tolerance(const BoundDesign& design, std::size_t index) const;
  void check_sliding(const BoundDesign& design, std::size_t index) const;
  void check_sliding(const std::vector<Affine>& derivative, const std::string& what) const;
  std::vector<double> pull_back(std::span<const double> variables, const Points& cotangent, const RunContext& context) const;

  const HandleMode handles_;
  std::vector<PointId> all_;       ///< of soft handles
  std::vector<PointId> sliding_;   ///< handle points on symmetry planes, ascending
  double largest_coordinate_ = 0;  ///< by magnitude, of the mesh
  Stopwatch watch_;
};

}  // namespace deform
