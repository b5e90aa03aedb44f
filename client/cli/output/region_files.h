// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "client/cli/setup/region_points.h"
#include "core/io/coloured_ply.h"

namespace deform::cli {

/// What a picture of the regions of a setup shows.
struct RegionPicture {
  ResolvedRegions regions;
  std::optional<std::vector<PointId>> centres;  ///< ascending; nothing where they are not known
};

/// One line of the legend.
struct LegendEntry {
  std::uint32_t value = 0;  ///< of the array `region`, or of `constraint`
  std::string kind;         ///< "free", "fixed", "handle" or "constraint"
  std::string name;         ///< of handle or constraint
  io::Colour colour{};
  std::size_t points = 0, centres = 0;
};
/// The entries of the regions by their values, free first; then those of the constraints in order, from 1.
std::vector<LegendEntry> legend(const RegionPicture& picture);

/// "#e69f00".
std::string colour_text(const io::Colour& colour);

/// The mesh with its points coloured: for the first seven handles the palette of Okabe and Ito, which colour-blind people tell
/// apart, then the same darker and lighter; fixed dark grey, free light grey, constrained points that are free indigo. With
/// centres known, points of handles and fixed ones that are none are pale.
/// .ply: colours of vertices. .vtp: the faces (of a volume mesh those of its boundary) over all points; .vtu: the cells of a
/// volume mesh; both with arrays of the points: `region` (0 free, 1 fixed, then the handles in order), `colour`, where there are
/// some `constraint` (0 none, else the first that has the point, from 1) and for each of the first fifty `constraint NAME` (0, or
/// which of its regions, from 1), `centre` (0 or 1) where they are known, `contested` (1: two regions want the point) where there
/// are some; and with the names of the values as field data `region_names` and `constraint_names`. Throws
/// Error(invalid_argument) for another extension, or .vtu of a mesh without cells.
void write_regions(const Mesh& mesh, const RegionPicture& picture, const std::filesystem::path& path);

}  // namespace deform::cli
