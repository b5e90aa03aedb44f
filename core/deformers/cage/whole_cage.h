// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "core/deformers/handles/control_images.h"
#include "core/deformers/handles/symmetry.h"
#include "core/deformers/setup.h"
#include "core/numerics/cage/cage.h"

namespace deform {

/// The cage of a setup with its images in symmetry planes, as one surface around the whole model. One that is its own mirror
/// image, or that of a whole wheel, already is. One that ends in a plane loses its faces in it, which would be inside, and is
/// closed by its mirror image, with which it has the vertices of these faces in common, but for those that no other face has.
struct WholeCage {
  Cage cage;
  /// Of each vertex of `cage` the vertex of the setup's cage and the image of it that it is, see Symmetry::image().
  std::vector<ControlSources::Source> vertices;
  std::vector<std::uint32_t> triangles;  ///< of each triangle of `cage` that of the setup's cage
  ControlMatches matches;                ///< of the vertices of the setup's cage
  std::size_t controls = 0;              ///< how many these are
  std::vector<std::string> notes;        ///< its size

  /// Which handles hold vertices of which none is left, one sentence each.
  std::vector<std::string> idle_notes(const Setup& setup, const SelectedRegions& regions) const;
  std::size_t bytes() const;
};

/// Throws Error(invalid_argument): the errors of cage_of() and cage_planes(), and if the surface is no cage.
WholeCage whole_cage(const CageOptions& options, const Symmetry& symmetry);

}  // namespace deform
