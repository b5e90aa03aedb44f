// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "core/deformers/handles/handle_motion.h"
#include "core/deformers/handles/symmetry.h"
#include "core/deformers/setup.h"

namespace deform {

/// Which control points are images of each other, in symmetry planes or by turns of a sector.
struct ControlMatches {
  static constexpr std::uint32_t no_control = ~std::uint32_t{0};

  /// For each symmetry plane that is matched the mirror image of each control point among them, or no_control; else empty. Of
  /// sectors that are matched the images of control points turned by one sector; where these are those of one sector only, also
  /// turned back, and an image has no further one; else none.
  std::vector<std::vector<std::uint32_t>> images{};
  unsigned sectors = 0;  ///< of the wheel; 0 without a sector

  /// The subsets of planes that are matched, ascending; without planes only 0, which is no image.
  std::vector<unsigned> matched_planes() const;
  /// A control point in an image.
  struct Image {
    unsigned image;
    std::uint32_t control;
  };
  /// The images of a control point that are control points, ascending, first itself.
  std::vector<Image> images_of(std::uint32_t control) const;
  bool empty() const;  ///< whether no control point has an image
  std::size_t bytes() const;
};

/// Components of displacements that images take alike: times a factor, if one alone is considered.
struct ComponentPart {
  std::vector<std::size_t> components;
  int odd = -1;                                              ///< the plane along whose normal the component is
  enum class Turn { none, cosine, sine } turn = Turn::none;  ///< across the axis of a sector; the sines are those of turned ones

  double factor(const Symmetry& symmetry, unsigned image) const;
  /// A displacement in the frame with these components only, those of sines turned by a quarter; and the transpose.
  Vec3 taken(const Vec3& u) const;
  Vec3 given(const Vec3& u) const;
};
/// The parts that make up displacements in the images of some planes (mask), or of a sector.
std::vector<ComponentPart> component_parts(const Symmetry& symmetry, unsigned planes = 7);

/// Throws Error(invalid_argument) if a control point is fixed and an image of it is in a handle.
void check_images(const ControlMatches& matches, const Setup& setup, const SelectedRegions& regions);

/// What moves control points: handles move those that they hold, and the images of these with them. A control point of which a
/// handle holds several images gets the mean of their motions, which must be images of each other; one in a plane is its own
/// image. Displacements are in the frame of the symmetry. Immutable; any thread.
class ControlSources {
 public:
  struct Source {
    std::uint32_t control;  ///< in a handle
    unsigned image;         ///< that the control point which it moves is of it
  };

  /// For `count` control points.
  ControlSources(const ControlMatches& matches, std::size_t count, const SelectedRegions& regions);

  std::size_t size() const { return first_.size() - 1; }
  std::span<const Source> of(std::size_t control) const {
    return {sources_.data() + first_[control], first_[control + 1] - first_[control]};
  }
  std::size_t bytes() const { return bytes_for(size(), sources_.size()); }
  static std::size_t bytes_for(std::size_t controls, std::size_t sources) {
    return (controls + 1) * sizeof(std::size_t) + sources * sizeof(Source);
  }

  /// The displacements of all control points from those of the ones in handles (model coordinates, the others are not read).
  /// Without symmetry they are these.
  std::vector<Vec3> displacements(std::vector<Vec3> own, const Symmetry& symmetry) const;
  /// The transpose, but that what it returns is in the frame as well: vectors at the control points in handles, 0 at the others.
  std::vector<Vec3> transposed(std::span<const Vec3> at_controls, const Symmetry& symmetry) const;

  /// Throw Error(invalid_argument) that names two control points if motions of images of each other are not, of a design and of
  /// the rates at which affine motions change. `held` are the control points; messages begin with "designs[index]" and `what`.
  void check_design(const HeldPoints& held, const BoundDesign& design, std::size_t index) const;
  void check_rates(const HeldPoints& held, const std::vector<Affine>& rates, const std::string& what) const;

  /// "3 vertices are in handles, 2 are mirror images of these and move with them, the other 7 stay.", of `word` "vertices".
  std::string note(const SelectedRegions& regions, const std::string& word) const;

 private:
  void check_agreement(const HeldPoints& held, const std::function<Vec3(PointId)>& motion_of, double allowed,
                       const std::string& what) const;

  unsigned sectors_ = 0;
  bool matched_ = false;  ///< whether any control point may be an image of another
  std::vector<std::size_t> first_;
  std::vector<Source> sources_;
};

/// Contracts vectors at control points with the fields of the handles that hold them: 4H x 3, row-major. `fields` has those of
/// each control point.
std::vector<double> field_sums(const SelectedRegions& regions, std::span<const std::array<double, 4>> fields,
                               std::span<const Vec3> at_controls);

}  // namespace deform
