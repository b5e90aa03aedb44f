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
/// How many points a file of them has.
std::size_t openfoam_point_count(const FoamFiles::Part& points);

/// Whether the path is a folder that holds a polyMesh, or the `points` of one, or a time or a region of one in a case.
bool is_openfoam(const std::filesystem::path& path);
/// Throws Error(invalid_argument) where a folder that is not is_openfoam() is a case of several regions or of processor folders.
void explain_no_mesh(const std::filesystem::path& path);
/// Throws Error(invalid_argument) where the result of a mesh would not be found again at `output`: a case instead of one of its
/// time folders, a time folder instead of the region of the source in it.
void check_openfoam_output(const std::filesystem::path& source, const std::filesystem::path& output);
/// Faces, cells and patches that do not stand beside the points are those of the last time folder up to that of the points that
/// has some, else of constant, in the same region. Throws Error(invalid_argument) where those faces leave points without use.
std::unique_ptr<MeshFile> read_openfoam(const std::filesystem::path& path);
/// The `points` that is read for `path`, which is_openfoam().
std::filesystem::path openfoam_source_points(const std::filesystem::path& path);
/// replaced_source() for a source that is_openfoam().
std::optional<std::filesystem::path> replaced_openfoam_points(const std::filesystem::path& source,
                                                              const std::filesystem::path& output);
/// Where the points of an OpenFOAM mesh go that are written to `path`, see write_mesh_file().
std::filesystem::path openfoam_points_path(const std::filesystem::path& path);

}  // namespace deform::io
