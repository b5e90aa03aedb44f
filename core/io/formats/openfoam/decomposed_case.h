// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/io/mesh_file.h"

namespace deform::io {

/// The same place in every part of a decomposed OpenFOAM case: CASE/processor*/PLACE stands for CASE/processor0/PLACE,
/// CASE/processor1/PLACE and so on, or for folders of the file handler "collated", of which each has several parts in its files:
/// CASE/processors4/PLACE, or CASE/processors4_0-1/PLACE and CASE/processors4_2-3/PLACE.
struct CaseParts {
  /// A folder of collated parts.
  struct Collated {
    std::string name;
    std::size_t first = 0, count = 0;  ///< its parts
  };

  std::filesystem::path root;      ///< CASE
  std::size_t count = 0;           ///< of the parts
  std::filesystem::path place;     ///< below the folder of the part: empty, constant, a time, or the folder of a region in one
  std::vector<Collated> collated;  ///< by their first part; empty if each part has a folder

  std::size_t folders() const { return collated.empty() ? count : collated.size(); }
  std::string folder(std::size_t k) const { return collated.empty() ? "processor" + std::to_string(k) : collated[k].name; }
  std::filesystem::path at(std::size_t k) const { return root / folder(k) / place; }
};

/// The parts that a path names: CASE/processor*/PLACE, CASE/processorsN/PLACE, a CASE/PLACE that is in the parts only, or a case
/// that has no mesh but that of its parts; else std::nullopt. Throws Error(not_found) naming a part that is missing or has no
/// mesh, and Error(invalid_argument) for a case that was decomposed into several numbers of collated parts.
std::optional<CaseParts> case_parts(const std::filesystem::path& path);
/// Puts the mesh together by the files pointProcAddressing, faceProcAddressing and cellProcAddressing of the parts: points,
/// faces, cells, patches and zones as in the case before it was decomposed. Throws Error(invalid_argument) naming file and entry
/// where these do not fit the meshes of the parts or each other, or where the parts have different places for a point.
std::unique_ptr<MeshFile> read_parts(const CaseParts& parts);
/// Where the points of such parts are written for `output`: OUTPUT, which may contain processor* or the name of one of the
/// folders, otherwise their names are put after the folder that has the parts of a case, or at the end.
CaseParts output_parts(const std::filesystem::path& output, CaseParts parts);
/// The path with processor* of the points that are read, with all links resolved.
std::filesystem::path parts_source_points(const CaseParts& parts);
/// replaced_source() for the parts.
std::optional<std::filesystem::path> replaced_parts(const CaseParts& parts, const std::filesystem::path& output);
/// check_output() for the parts.
void check_parts_output(const CaseParts& parts, const std::filesystem::path& output);

}  // namespace deform::io
