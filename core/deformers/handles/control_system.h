// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/deformers/handles/control_functions.h"
#include "core/deformers/handles/control_images.h"
#include "core/deformers/handles/handle_system.h"
#include "core/deformers/handles/space_functions.h"

namespace deform {

/// The functions of control points at the points of a mesh, or at images of these. The control points have an image, in symmetry
/// planes or other sectors, that moves the points of the mesh: these are taken back from there, and their displacements forth.
struct ControlImage {
  unsigned image = 0;                            ///< of the control points, see Symmetry::image()
  std::shared_ptr<const ControlFunctions> rows;  ///< n x k; null if all functions are zero at all points
  std::vector<std::uint8_t> reflected;           ///< n: the planes of each point, if they are not `image`

  unsigned image_of(std::size_t point) const { return reflected.empty() ? image : reflected[point]; }
};

/// Control points and their functions on a mesh: the displacement of a point is the sum of the displacements of the control
/// points times their functions at the point, with symmetry planes added up over its images.
///
/// In a symmetry plane that is `matched` control points are mirror images of each other: what moves one of them moves the other,
/// and a point may take its functions from either of its images, as they are the same where both have any. In another plane the
/// mirror image of all control points stands beside them, so that displacements add up.
///
/// In the sector of a wheel the control points either are those of the whole wheel, images of each other in all sectors, and are
/// matched. Or each sector has an image of all control points, and displacements add up where several reach.
struct ControlModel {
  std::shared_ptr<const Mesh> controls;  ///< its points are the k control points
  /// One for each subset of the planes that are not matched, none first; of a sector one for each that reaches the mesh, itself
  /// first.
  std::vector<ControlImage> images;
  std::shared_ptr<const SpaceFunctions> in_space;  ///< the functions at any place
  ControlMatches matches;
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

  std::size_t row_bytes() const;  ///< memory of the images
};

/// Handles move control points, the other control points stay, and all points of the mesh follow (classical free-form
/// deformation, thesis 3.2). The handle basis, its derivatives and populations are those of HandleSystem; without a basis,
/// evaluating a design takes one sum per point. With symmetry planes or a sector the displacements of control points are in their
/// frame, and those of which an image is in a handle move with it.
class ControlSystem : public HandleSystem {
 public:
  /// Only the basis options of `options` are used. Throws the errors of HandleSystem and check_images().
  ControlSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, ControlModel model, const EnergyOptions& options,
                const RunContext& context);

  std::unique_ptr<const Evaluation> bind(std::span<const Design> designs, EvaluationPath path,
                                         const RunContext& context) const override;

  /// How many bases the components of displacements need.
  static std::size_t part_count(const Symmetry& symmetry) { return component_parts(symmetry).size(); }

 private:
  friend class ControlEvaluation;

  std::unique_ptr<const Evaluation> derivative(std::span<const double> variables, const std::vector<Affine>& maps,
                                               const RunContext& context) const override;
  Fields adjoint(std::span<const double> variables, Cotangents at_following, const RunContext& context) const override;
  std::string only_on_mesh() const override { return {}; }
  std::string unchecked_motions() const override;
  void check_motions(const BoundDesign& design, std::size_t index) const override;
  void check_motions(const std::vector<Affine>& derivative, const std::string& what) const override;
  void prepare_basis(const EnergyOptions& options, const RunContext& context);
  void add_part(const ComponentPart& part, double tolerance, const RunContext& context);
  /// The rounding error of a displacement, as a fraction of the largest one of a control point.
  double rounding() const { return static_cast<double>(model_.images.size()) * model_.rounding; }
  void fill_info();
  /// The names of handles whose control points have no influence on the mesh.
  std::vector<std::string> idle_handles(const RunContext& context) const;
  bool moves(std::size_t control) const { return points_.region_of[control] < fixed_region; }
  /// The first field of the handle of a control point that moves().
  std::size_t first_field(std::size_t control) const { return std::size_t{4} * points_.region_of[control]; }
  /// use(control, value, image) for the functions at a point of the mesh of all images of the control points. The second of two
  /// partners has those of the first, turned.
  template <typename Use>
  void for_each_image(PointId id, const Use& use) const {
    const Symmetry& symmetry = regions_.symmetry;
    const PointId first = symmetry.sector().first_of(id);
    for (const ControlImage& image : model_.images) {
      if (!image.rows) continue;
      const unsigned number = symmetry.composed(image.image_of(first), first == id ? 0 : 1);
      image.rows->for_each(static_cast<std::int64_t>(first),
                           [&](std::int64_t column, double value) { use(static_cast<std::size_t>(column), value, number); });
    }
  }
  /// The displacements of the k control points, with symmetry planes or a sector in their frame.
  std::vector<Vec3> displacements(const BoundDesign& design, MotionKind kind) const;

  const ControlModel model_;
  std::vector<std::array<double, 4>> fields_;  ///< fields of its handle at each control point, unit coordinates
  const ControlSources sources_;
  std::vector<std::string> idle_;
};

/// Estimates the cost of a ControlSystem before anything is computed, from `images` and `notes` of the model.
Estimate estimate_controls(const Mesh& mesh, const ControlModel& model, const EnergyOptions& options,
                           const SelectedRegions& regions);

}  // namespace deform
