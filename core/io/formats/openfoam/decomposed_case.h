// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "core/io/mesh_file.h"

namespace deform::io {

/// The same place in every part of a decomposed OpenFOAM case: CASE/processor*/PLACE stands for CASE/processor0/PLACE,
/// CASE/processor1/PLACE and so on.
struct CaseParts {
  std::filesystem::path root;   ///< CASE
  std::size_t count = 0;        ///< of the parts
  std::filesystem::path place;  ///< below the folder of the part: empty, constant, a time, or the folder of a region in one

  std::filesystem::path at(std::size_t part) const { return root / ("processor" + std::to_string(part)) / place; }
};

/// The parts that a path names: CASE/processor*/PLACE, or a case that has no mesh but that of its parts; else std::nullopt.
/// Throws Error(not_found) naming a part that is missing or has no mesh.
std::optional<CaseParts> case_parts(const std::filesystem::path& path);
/// Puts the mesh together by the files pointProcAddressing, faceProcAddressing and cellProcAddressing of the parts: points,
/// faces, cells, patches and zones as in the case before it was decomposed. Throws Error(invalid_argument) naming file and entry
/// where these do not fit the meshes of the parts or each other, or where the parts have different places for a point.
std::unique_ptr<MeshFile> read_parts(const CaseParts& parts);
/// Where the points of the parts are written for `output`: OUTPUT, which may contain processor*, otherwise processorN is put
/// after the folder that has the parts of a case, or at the end.
CaseParts output_parts(const std::filesystem::path& output, std::size_t count);
/// The path with processor* of the points that are read, with all links resolved.
std::filesystem::path parts_source_points(const CaseParts& parts);
/// replaced_source() for the parts.
std::optional<std::filesystem::path> replaced_parts(const CaseParts& parts, const std::filesystem::path& output);
/// check_output() for the parts.
void check_parts_output(const CaseParts& parts, const std::filesystem::path& output);

}  // namespace deform::io
