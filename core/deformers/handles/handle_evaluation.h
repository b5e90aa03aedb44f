// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "core/base/parallel.h"
#include "core/deformers/handles/handle_system.h"
#include "core/deformers/space_map.h"

namespace deform {

/// Designs bound to a HandleSystem. This class chooses their paths, computes the coefficients of those on the basis path, and
/// computes points from the displacements of tiles. The constructor of a derived class solves for the designs on the direct path
/// and completes their reports; its direct_tile() returns their displacements.
class HandleEvaluation : public Evaluation {
  friend class HandleMap;

 public:
  std::size_t design_count() const final { return designs_.size(); }
  const DesignReport& report(std::size_t design) const final { return reports_[design]; }
  void evaluate(std::size_t begin, std::size_t end, std::size_t first, std::span<Vec3* const> out) const final;
  std::optional<FieldMotion> field_motion(std::size_t design) const final;

 protected:
  /// Positions for the designs of System::bind().
  HandleEvaluation(std::shared_ptr<const HandleSystem> system, std::span<const Design> designs, EvaluationPath path,
                   const RunContext& context);
  /// A derivative: the displacement field for one affine map per handle. evaluate() returns the field itself.
  HandleEvaluation(std::shared_ptr<const HandleSystem> system, const std::vector<Affine>& derivatives);

  /// Writes the displacements of `count` designs on the direct path at a tile of the following points to
  /// values[design][component][16], in the frame of the symmetry planes.
  virtual void direct_tile(std::size_t tile, std::size_t first, std::size_t count, double* values) const = 0;
  /// Writes the displacements of the first design, which is on the direct path, at any points (model units) to `out`, in the
  /// frame of the symmetry planes; see SpaceMap::evaluate(). Only for systems that are defined off the mesh.
  virtual SpaceMap::Found displacements_at(std::span<const Vec3> points, std::uint64_t first, std::span<Vec3> out,
                                           const RunContext& context) const;
  /// The points that replace_points() replaces in the first design, with their positions, ascending.
  virtual std::vector<std::pair<PointId, Vec3>> replaced() const { return {}; }
  /// Replaces those of the points [begin, end) that the solution does not determine; see evaluate().
  virtual void replace_points(std::size_t begin, std::size_t end, std::size_t first, std::span<Vec3* const> out) const;

  /// The error of a design on the basis path that results from the errors of the bases, model units: `margin` times the largest
  /// norm at the checked points, or with hard handles the largest misfit, plus that of the sums; 0 if they are unknown.
  double basis_error(std::size_t design, double margin) const;
  /// The largest error of a design on the basis path that the compression of the bases can cause, model units.
  double compression_error(std::size_t design) const;
  /// The error that a solver which works to a tolerance may leave in a design, model units: a fraction of D, or of the motion if
  /// that is larger.
  double allowed_error(std::size_t design) const;
  /// For an iterative solver: whether the errors of the designs are what it was to reach.
  void judge();
  bool is_direct(std::size_t design) const { return reports_[design].path == EvaluationPath::direct; }
  std::size_t direct_designs() const { return direct_designs_; }
  /// The position of a design among those of its path.
  std::size_t slot(std::size_t design) const { return slot_[design]; }
  /// Sets the error in the report of a design from that of its displacements, to which the rounding of the points and of what is
  /// prescribed is added.
  void set_error(std::size_t design, double error);
  /// The largest term of the sums that the prescribed displacements of a design are, model units.
  double largest_terms(std::size_t design) const;
  /// The displacement of a handle or fixed point, in the frame of the symmetry planes, if any.
  Vec3 prescribed_displacement(const BoundDesign& design, PointId id) const;
  /// Calls solve(design) for the designs on the direct path, in parallel but each separately: BLAS changes the order of summation
  /// with the number of columns, and a design must not depend on the others, bit for bit.
  template <typename Solve>
  void for_each_direct(const RunContext& context, const Solve& solve) const {
    parallel_for(context, designs_.size(), 1, [&](std::size_t design, std::size_t) {
      if (is_direct(design)) solve(design);
    });
    context.check();
  }

  HeldPoints held_;  ///< those of the system
  MotionKind kind_ = MotionKind::position;
  std::vector<BoundDesign> designs_;
  std::vector<DesignReport> reports_;

 private:
  void choose_paths(EvaluationPath path);
  void set_basis_coefficients();
  void choose_fields();
  /// Whether the bases have their errors at handle and fixed points.
  bool measures_misfits() const;
  /// The largest norm of the errors of a design on the basis path at the checked points, model units.
  double largest_checked(std::size_t design) const;
  void evaluate_prescribed(std::size_t begin, std::size_t end, std::size_t first, std::span<Vec3* const> out) const;
  struct Pass;
  std::size_t designs_in_pass(std::size_t first, std::size_t count) const;
  void evaluate_following(std::size_t begin, std::size_t end, std::size_t first, std::span<Vec3* const> out) const;
  void start_sums(std::size_t first, std::size_t count, Pass& pass) const;
  void fill_tile(std::size_t tile, std::size_t first, std::size_t count, Pass& pass) const;
  void place_tile(std::size_t low, std::size_t high, std::size_t begin, const Pass& pass, std::span<Vec3* const> out) const;
  /// The coefficients of a design for one field of a basis, one for each component.
  const double* coefficients(std::size_t basis, std::size_t field, std::size_t design) const;

  std::shared_ptr<const HandleSystem> system_;
  std::vector<std::size_t> slot_;
  std::size_t basis_designs_ = 0, direct_designs_ = 0;
  /// For each basis of the system 4H x (components of each design on the basis path), row-major.
  std::vector<std::vector<double>> coefficients_;
  /// For each basis, the fields with a nonzero coefficient in any design, ascending. A translation needs only one of four.
  std::vector<std::vector<std::uint32_t>> moving_fields_;
};

/// Adds the values of some components, part[design][position in `components`][16], to values[design][component][16].
void add_components(const std::vector<std::size_t>& components, std::size_t designs, const double* part, double* values);

}  // namespace deform
