// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "core/io/mesh_file.h"

namespace deform::io {

/// The bytes of the files of a polyMesh folder; zones may be missing (empty). Names are used in errors.
struct FoamFiles {
  struct Part {
    std::string bytes, name;
  };
  Part points, faces, owner, neighbour, boundary, point_zones, face_zones, cell_zones;
};
std::unique_ptr<MeshFile> parse_openfoam(FoamFiles files);
/// The files of a mesh in the file system.
struct FoamFolder {
  FoamFiles files;
  std::filesystem::path points, topology;  ///< the file of the points, the folder of the faces
  bool compressed = false;                 ///< whether the points were
};
/// For a path that satisfies is_openfoam(). faces_of: as of ReadOptions.
FoamFolder load_openfoam(const std::filesystem::path& path, const std::filesystem::path& faces_of = {});
/// FOLDER/NAME or FOLDER/NAME.gz. Throws Error(not_found) if there is neither, saying what it would be.
FoamFiles::Part load_openfoam_file(const std::filesystem::path& folder, const char* name,
                                   const char* what =
                                       "which an OpenFOAM mesh has beside its points; a result of deform sweep is "
                                       "points alone: name the original as well (--before of deform quality), or link faces, "
                                       "owner, neighbour and boundary of it beside them");
/// The number of points in a `points` file.
std::size_t openfoam_point_count(const FoamFiles::Part& points);

/// Whether the path is a folder with a polyMesh, the `points` of one, or a time or region folder of a case.
bool is_openfoam(const std::filesystem::path& path);
/// For a path that is not is_openfoam(): throws Error(invalid_argument) if it is a folder, saying whether it is a case of several
/// regions or of collated parts, and Error(not_found) if nothing is there and the name is that of no format.
void explain_no_mesh(const std::filesystem::path& path);
/// Throws Error(invalid_argument) if a mesh written to `output` would not be found there again: a case instead of one of its time
/// folders, a time folder instead of the region of the source in it or a region where the source has none, or a folder of the
/// whole case or of another part for a source in one part (processorN) of a decomposed case, and the other way round; or if the
/// case has a folder of the same time under another name.
void check_openfoam_output(const std::filesystem::path& source, const std::filesystem::path& output);
/// Reads a mesh. Faces, cells and patches that are not next to the points are taken from the last time folder up to that of the
/// points that has some, otherwise from constant, in the same region, otherwise from the mesh `faces_of` (see ReadOptions).
/// Throws Error(invalid_argument) if those faces leave points unused.
std::unique_ptr<MeshFile> read_openfoam(const std::filesystem::path& path, const std::filesystem::path& faces_of = {});
/// The `points` file that is read for `path`, which must satisfy is_openfoam().
std::filesystem::path openfoam_source_points(const std::filesystem::path& path);
/// replaced_source() for a source that satisfies is_openfoam().
std::optional<std::filesystem::path> replaced_openfoam_points(const std::filesystem::path& source,
                                                              const std::filesystem::path& output);
/// The file to which the points of an OpenFOAM mesh are written for `path`, see write_mesh_file().
std::filesystem::path openfoam_points_path(const std::filesystem::path& path);

}  // namespace deform::io
