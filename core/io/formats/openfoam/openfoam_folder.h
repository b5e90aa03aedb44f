// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "core/io/mesh_file.h"

namespace deform::io {

/// The bytes of the files of a polyMesh folder; zones may be missing (empty). Names stand in errors.
struct FoamFiles {
  struct Part {
    std::string bytes, name;
  };
  Part points, faces, owner, neighbour, boundary, point_zones, face_zones, cell_zones;
};
std::unique_ptr<MeshFile> parse_openfoam(FoamFiles files);

/// Whether the path is a folder that holds a polyMesh, or the `points` of one.
bool is_openfoam(const std::filesystem::path& path);
std::unique_ptr<MeshFile> read_openfoam(const std::filesystem::path& path);
/// The `points` that is read for `path`, which is_openfoam().
std::filesystem::path openfoam_source_points(const std::filesystem::path& path);
/// replaced_source() for a source that is_openfoam().
std::optional<std::filesystem::path> replaced_openfoam_points(const std::filesystem::path& source,
                                                              const std::filesystem::path& output);
/// Where the points of an OpenFOAM mesh go that are written to `path`, see write_mesh_file().
std::filesystem::path openfoam_points_path(const std::filesystem::path& path);

}  // namespace deform::io
