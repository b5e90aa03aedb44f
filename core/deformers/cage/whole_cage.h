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

/// The cage of a setup with its images in symmetry planes or other sectors, as one surface around the whole model. One that is
/// its own mirror image, or that of a whole wheel, already is. One that ends in a plane, or in periodic boundaries, loses its
/// faces in it, which would be inside, and is closed by its images, with which it has the vertices of these faces in common, but
/// for those that no other face has.
struct WholeCage {
  Cage cage;
  /// For each vertex of `cage` the vertex of the setup's cage and the image of it that it is, see Symmetry::image().
  std::vector<ControlSources::Source> vertices;
  /// The same of each triangle; image 0 of each that is left is one of them.
  std::vector<ControlSources::Source> triangles;
  ControlMatches matches;          ///< of the vertices of the setup's cage
  std::size_t controls = 0;        ///< how many these are
  std::vector<std::string> notes;  ///< its size
  bool has_images = false;         ///< whether any vertex of `cage` is an image other than 0

  /// Which handles hold vertices of which none is left, one sentence each.
  std::vector<std::string> idle_notes(const Setup& setup, const SelectedRegions& regions) const;
  std::size_t bytes() const;
};

/// Throws Error(invalid_argument): the errors of cage_of() and cage_planes(), and if the surface is no cage.
WholeCage whole_cage(const CageOptions& options, const Symmetry& symmetry);

}  // namespace deform
