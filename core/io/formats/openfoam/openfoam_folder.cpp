// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/openfoam/openfoam_folder.h"

#include "core/base/error.h"
#include "core/io/readers.h"

namespace deform::io {

namespace {

namespace fs = std::filesystem;

/// FOLDER/NAME or FOLDER/NAME.gz, whichever is there.
std::optional<fs::path> existing(const fs::path& folder, const char* name) {
  for (const char* ending : {"", ".gz"}) {
    fs::path path = folder / (std::string(name) + ending);
    if (fs::is_regular_file(path)) return path;
  }
  return std::nullopt;
}

std::optional<fs::path> find_points(const fs::path& path) {
  if (fs::is_directory(path)) {
    for (const fs::path& folder : {path / "constant" / "polyMesh", path / "polyMesh", path}) {
      if (auto points = existing(folder, "points")) return points;
    }
    return std::nullopt;
  }
  const fs::path name = path.filename();
  if ((name == "points" || name == "points.gz") && fs::is_regular_file(path)) return path;
  return std::nullopt;
}

/// A time folder has only the points that moved: the rest is in constant/polyMesh of the case.
fs::path topology_folder(const fs::path& points) {
  const fs::path own = fs::absolute(points).parent_path();
  if (existing(own, "faces")) return own;
  return own.parent_path().parent_path() / "constant" / "polyMesh";
}

FoamFiles::Part load(const fs::path& folder, const char* name) {
  const auto path = existing(folder, name);
  if (!path) {
    throw Error(ErrorCode::not_found,
                "cannot open " + (folder / name).string() + ", which an OpenFOAM mesh has beside its points");
  }
  return {read_file(*path), path->string()};
}

FoamFiles::Part load_if_there(const fs::path& folder, const char* name) {
  return existing(folder, name) ? load(folder, name) : FoamFiles::Part{};
}

}  // namespace

bool is_openfoam(const fs::path& path) { return find_points(path).has_value(); }

std::unique_ptr<MeshFile> read_openfoam(const fs::path& path) {
  const fs::path points = find_points(path).value();
  const fs::path folder = topology_folder(points);
  FoamFiles files;
  bool compressed = false;
  files.points = {read_file(points, &compressed), points.string()};
  files.faces = load(folder, "faces");
  files.owner = load(folder, "owner");
  files.neighbour = load(folder, "neighbour");
  files.boundary = load(folder, "boundary");
  files.point_zones = load_if_there(folder, "pointZones");
  files.face_zones = load_if_there(folder, "faceZones");
  files.cell_zones = load_if_there(folder, "cellZones");
  auto file = parse_openfoam(std::move(files));
  file->compressed = compressed;
  return file;
}

fs::path openfoam_source_points(const fs::path& path) { return find_points(path).value(); }

std::optional<fs::path> replaced_openfoam_points(const fs::path& source, const fs::path& output) {
  const auto same = [](const fs::path& a, const fs::path& b) {
    std::error_code missing;
    return fs::equivalent(a, b, missing) && !missing;
  };
  const fs::path points = openfoam_source_points(source);
  const fs::path target = openfoam_points_path(fs::absolute(output));
  for (const fs::path& used : {fs::absolute(points).parent_path(), topology_folder(points)}) {
    const fs::path folder = (used / "points").lexically_normal().parent_path();
    const fs::path held = existing(folder, "points").value_or(points);
    if (same(target.parent_path(), folder) || same(target, held) || same(output, folder)) return held;
    // A case is no time folder: what is written into it would not be found, or be taken for its mesh.
    const fs::path holder = folder.parent_path();
    const bool in_case = folder.filename() == "polyMesh" && holder.filename() == "constant";
    if (in_case && same(output, holder.parent_path())) return held;
  }
  return std::nullopt;
}

fs::path openfoam_points_path(const fs::path& path) {
  const fs::path name = path.filename();
  if (name == "points" || name == "points.gz") return path;
  return path / "polyMesh" / "points";
}

Reader openfoam_reader() {
  const auto refuse = [](std::string, const std::string& name) -> std::unique_ptr<MeshFile> {
    throw Error(ErrorCode::invalid_argument, name + ": points alone are no mesh, the files beside them are needed");
  };
  return {.format = Format::openfoam, .name = "OpenFOAM", .extensions = {}, .parse = refuse};
}

}  // namespace deform::io
