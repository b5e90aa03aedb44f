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
#include "core/deformers/handles/flat_case.h"
#include "core/deformers/handles/handle_basis.h"
#include "core/deformers/handles/handle_motion.h"
#include "core/deformers/system.h"

namespace deform {

/// The base class of systems driven by handles. It holds the regions of a setup on a mesh, the handle basis and the chain rule
/// from the points to the design variables. A method derives from it and from HandleEvaluation and supplies its solution;
/// tests/support/uniform_blend.h is a small example.
///
/// Prescribed points (of handles and fixed regions, unless these are soft) get exactly their prescribed positions; the others
/// follow the solution. With symmetry planes the displacements of the following points are expressed in the frame of the planes,
/// where the normal component of a plane is zero at its points.
class HandleSystem : public System {
 public:
  const SystemInfo& info() const final { return info_; }
  Points jacobian_vector(std::span<const double> variables, std::span<const double> direction,
                         const RunContext& context) const final;
  std::vector<double> vector_jacobian(std::span<const double> variables, const Points& cotangent,
                                      const RunContext& context) const final;
  std::vector<std::vector<double>> vector_jacobians(std::span<const double> variables, std::span<const Points> cotangents,
                                                    const RunContext& context) const final;
  std::unique_ptr<const DisplacementFields> displacement_fields() const final;
  std::unique_ptr<const SpaceMap> bind_in_space(const Design& design, const RunContext& context) const final;
  SpaceBytes space_bytes(std::size_t points) const override;

 protected:
  friend class HandleEvaluation;
  friend class CompiledForm;
  friend class HandleFields;
  friend class HandleMap;
  friend class StoredBasis;

  using Unit = UnitLength;
  HandleSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, HandleMode handles, Unit unit, const RunContext& context);
  /// For handles and fixed regions that select control points (SelectedRegions::of), which are the points of `controls`. All
  /// points of the mesh follow. The unit is the diagonal of the mesh.
  HandleSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, std::shared_ptr<const Mesh> controls,
               const RunContext& context);

  /// The derivative of the deformation at `variables` when the motions of the handles change by `maps`: a displacement field.
  virtual std::unique_ptr<const Evaluation> derivative(std::span<const double> variables, const std::vector<Affine>& maps,
                                                       const RunContext& context) const = 0;
  /// The transpose of the map from fields of the handles to displacements of the following points (in the frame of the planes),
  /// without a basis: for each cotangent 4H x 3, row-major, from one vector for each following point.
  using Fields = std::vector<std::vector<double>>;
  using Cotangents = std::span<const std::vector<Vec3>>;
  virtual Fields adjoint(std::span<const double> variables, Cotangents at_following, const RunContext& context) const = 0;
  /// Why the deformation is not defined off the mesh; empty if it is, and HandleEvaluation::displacements_at() then as well.
  virtual std::string only_on_mesh() const;
  /// Why a system without a basis cannot be compiled, and what to do.
  virtual std::string without_basis() const;

  /// Why designs of variables would have to be checked by what evaluates a compiled deformation, which cannot; empty if they need
  /// not be.
  virtual std::string unchecked_motions() const;

  /// Further checks of a design, and of the rates at which motions change, which start messages with `what`: throw
  /// Error(invalid_argument).
  virtual void check_motions(const BoundDesign& design, std::size_t index) const;
  virtual void check_motions(const std::vector<Affine>& derivative, const std::string& what) const;

  /// Whether handle and fixed points are met exactly.
  bool hard_handles() const { return handles_ == HandleMode::hard; }
  bool is_prescribed(PointId id) const { return hard_handles() && points_.region_of[id] != deformable_region; }
  /// The points that follow the solution, ascending.
  const std::vector<PointId>& following() const { return hard_handles() ? points_.deformable : all_; }
  bool has_basis() const { return !basis_.empty(); }
  std::size_t fields() const { return 4 * frames_.size(); }
  HeldPoints held() const {
    return {*held_mesh_, setup_, regions_, held_symmetry(), points_.region_of, rank_of_, points_.coincident, info_.diagonal};
  }
  /// The symmetry planes for the points of held_mesh_.
  const Symmetry& held_symmetry() const { return held_mesh_ == mesh_ ? regions_.symmetry : control_symmetry_; }
  /// The fields 1, x, y, z of a handle at one of its points, in unit coordinates relative to its reference point.
  std::array<double, 4> handle_fields(std::size_t handle, PointId id) const;
  /// A displacement in the frame of the planes without the normal components of those on which the point lies.
  Vec3 components(Vec3 in_frame, PointId id) const;
  /// Throws the errors of System::bind(): tolerances out of range, coincident points that separate, points that leave their
  /// symmetry plane, the axis or the plane of a FlatCase, partners on periodic boundaries with different motions.
  void check(const BoundDesign& design, std::size_t index) const;
  /// The following points in unit coordinates.
  std::vector<Vec3> following_places() const { return unit_places(*mesh_, box_, following()); }
  /// Stores a basis, compressed with a tolerance (see HandleBasis::compress()) or, if it is 0, unchanged.
  void add_basis(HandleBasis&& basis, double tolerance, const RunContext& context);
  /// Ends a stage of the preparation and records its seconds in info().
  void end_stage(const char* name) { info_.stage_seconds.emplace_back(name, watch_.lap()); }
  /// Sets memory and basis in info(). `more` is the memory of neither the factor nor the basis.
  void set_bytes(std::size_t factor_bytes, std::size_t more);

  const std::shared_ptr<const Mesh> mesh_;
  const std::shared_ptr<const Mesh> held_mesh_;  ///< whose points handles and fixed regions select: mesh_, or control points
  const Setup setup_;
  SelectedRegions regions_;
  ConstraintPoints points_;             ///< those of held_mesh_
  std::vector<std::uint32_t> rank_of_;  ///< for each point of held_mesh_: position of a handle point among those of its handle
  UnitBox box_;
  std::vector<HandleFrame> frames_;
  std::vector<HandleBasis> basis_;  ///< bases of different components; empty if none is stored
  SystemInfo info_;
  FlatCase flat_;

 private:
  struct Held;
  HandleSystem(Held held, const Setup& setup, HandleMode handles, Unit unit, const RunContext& context);
  void check_tolerance(const BoundDesign& design, std::size_t index) const;
  void check_sliding(const BoundDesign& design, std::size_t index) const;
  void check_sliding(const std::vector<Affine>& derivative, const std::string& what) const;
  void check_flat(const BoundDesign& design, std::size_t index) const;
  void check_sector(const BoundDesign& design, std::size_t index) const;
  void check_sector(const std::vector<Affine>& derivative, const std::string& what) const;
  const char* point_word() const { return held_mesh_ == mesh_ ? "point " : "control point "; }
  std::string name_of(PointId id) const;  ///< a handle or fixed point, for messages
  Fields pull_back(std::span<const double> variables, std::span<const Points> cotangents, const RunContext& context) const;

  const HandleMode handles_;
  std::vector<PointId> all_;       ///< all points, for soft handles
  Symmetry control_symmetry_;      ///< that of control points
  std::vector<PointId> sliding_;   ///< handle points on symmetry planes, ascending
  double largest_coordinate_ = 0;  ///< largest magnitude of a coordinate of the mesh
  Stopwatch watch_;
};

}  // namespace deform
