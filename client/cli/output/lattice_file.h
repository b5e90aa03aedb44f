// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "client/cli/setup/control_lattice.h"
#include "core/base/types.h"

namespace deform::cli {

/// A lattice to look at.
struct LatticePicture {
  const ControlLattice& lattice;
  std::vector<Vec3> moved;            ///< where its control points are in a design
  std::vector<std::uint32_t> labels;  ///< per control point, as region_labels(); empty: handles select no control points
  std::vector<std::string> handles;   ///< their names
};

/// A cage to look at.
struct CagePicture {
  std::vector<Vec3> places, moved;    ///< its vertices at rest, and in a design
  std::vector<PointId> corners;       ///< of its triangles, three each
  std::vector<std::uint32_t> labels;  ///< as of LatticePicture
  std::vector<std::string> handles;
};

/// Writes the triangles of a cage. Point data: `id` (from 0), `displacement` and `region` as of lattices. Throws
/// Error(invalid_argument) when the extension is not .vtp and for corners that are no vertices.
void write_cage(const CagePicture& picture, const std::filesystem::path& path);

/// Writes control points, in the order of their numbers, and the edges between neighbours as lines. Point data: `index` (i, j,
/// k), `displacement` (from where they are before a design moves them) and `region` with the names of its values. Throws
/// Error(invalid_argument) when the extension is not .vtp.
void write_lattice(const LatticePicture& picture, const std::filesystem::path& path);

}  // namespace deform::cli
