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
#include "core/deformers/handles/handle_system.h"
#include "core/deformers/handles/space_functions.h"

namespace deform {

/// The functions of control points at the points of a mesh, or at images of these in symmetry planes. A point is reflected into
/// the image, and its displacement back.
struct ControlImage {
  unsigned planes = 0;                           ///< in which the points are reflected (mask)
  std::shared_ptr<const ControlFunctions> rows;  ///< n x k; null if all functions are zero at all of them
  std::vector<std::uint8_t> reflected;           ///< n: the planes of each point, if they are not `planes`

  unsigned planes_of(std::size_t point) const { return reflected.empty() ? planes : reflected[point]; }
};

/// Control points and their functions on a mesh: the displacement of a point is the sum of the displacements of the control
/// points times their functions at the point, with symmetry planes added up over its images.
///
/// In a symmetry plane that is `matched` control points are mirror images of each other: what moves one of them moves the other,
/// and a point may take its functions from either of its images, as they are the same where both have any. In another plane the
/// mirror image of all control points stands beside them, so that displacements add up.
struct ControlModel {
  std::shared_ptr<const Mesh> controls;            ///< its points are the k control points
  std::vector<ControlImage> images;                ///< one for each subset of the planes that are not matched, none first
  std::shared_ptr<const SpaceFunctions> in_space;  ///< the functions at any place
  /// For each symmetry plane that is matched the mirror image of each control point among them, or no_control; else empty.
  std::vector<std::vector<std::uint32_t>> matches{};
  static constexpr std::uint32_t no_control = ~std::uint32_t{0};
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

  std::size_t row_bytes() const;    ///< memory of the images
  unsigned matched_planes() const;  ///< mask
  /// The image of a control point in matched planes (mask), or no_control.
  std::uint32_t image_of(std::uint32_t control, unsigned planes) const;
};

/// Handles move control points, the other control points stay, and all points of the mesh follow (classical free-form
/// deformation, thesis 3.2). The handle basis, its derivatives and populations are those of HandleSystem; without a basis,
/// evaluating a design takes one sum per point. With symmetry planes the displacements of control points are in the frame of
/// the planes, and those of which an image is in a handle move with it.
class ControlSystem : public HandleSystem {
 public:
  /// Only the basis options of `options` are used. Throws the errors of HandleSystem and check_images().
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
  void check_motions(const BoundDesign& design, std::size_t index) const override;
  void check_motions(const std::vector<Affine>& derivative, const std::string& what) const override;
  /// Throws if motions of control points that are images of each other are not, by more than `allowed`: motion_of(control).
  void check_agreement(const std::function<Vec3(PointId)>& motion_of, double allowed, const std::string& what) const;
  void prepare_basis(const EnergyOptions& options, const RunContext& context);
  /// A basis of these components: of the one along the normal of plane `odd`, or of others, for which it is -1.
  void add_part(std::vector<std::size_t> components, int odd, double tolerance, const RunContext& context);
  void find_sources();
  /// The rounding error of a displacement, as a fraction of the largest one of a control point.
  double rounding() const { return static_cast<double>(model_.images.size()) * model_.rounding; }
  void fill_info();
  /// The names of handles whose control points have no influence on the mesh.
  std::vector<std::string> idle_handles(const RunContext& context) const;
  bool moves(std::size_t control) const { return points_.region_of[control] < fixed_region; }
  /// The first field of the handle of a control point that moves().
  std::size_t first_field(std::size_t control) const { return std::size_t{4} * points_.region_of[control]; }
  /// What moves a control point: itself or its images, if handles hold them.
  struct Source {
    std::uint32_t control;
    unsigned planes;  ///< of the reflection from there (mask)
  };
  std::span<const Source> sources(std::size_t control) const {
    return {sources_.data() + first_source_[control], first_source_[control + 1] - first_source_[control]};
  }
  /// use(control, value, planes) for the functions at a point of the mesh in all of its images.
  template <typename Use>
  void for_each_image(PointId id, const Use& use) const {
    for (const ControlImage& image : model_.images) {
      if (!image.rows) continue;
      const unsigned planes = image.planes_of(id);
      image.rows->for_each(static_cast<std::int64_t>(id),
                           [&](std::int64_t column, double value) { use(static_cast<std::size_t>(column), value, planes); });
    }
  }
  /// The displacements of the k control points, with symmetry planes in their frame.
  std::vector<Vec3> displacements(const BoundDesign& design, MotionKind kind) const;

  const ControlModel model_;
  std::vector<std::array<double, 4>> fields_;  ///< fields of its handle at each control point, unit coordinates
  std::vector<std::size_t> first_source_;      ///< k + 1
  std::vector<Source> sources_;
  std::vector<std::string> idle_;
};

/// Throws Error(invalid_argument) if a control point is fixed and an image of it is in a handle.
void check_images(const ControlModel& model, const Setup& setup, const SelectedRegions& regions);

/// Estimates the cost of a ControlSystem before anything is computed, from `images` and `notes` of the model.
Estimate estimate_controls(const Mesh& mesh, const ControlModel& model, const EnergyOptions& options,
                           const SelectedRegions& regions);

}  // namespace deform
