// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/openfoam/openfoam_folder.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <utility>
#include <vector>

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

/// The name of a time folder as a number.
std::optional<double> time_of(const fs::path& folder) {
  const std::string name = folder.filename().string();
  double time = 0;
  const auto [end, error] = std::from_chars(name.data(), name.data() + name.size(), time);
  if (error != std::errc() || end != name.data() + name.size() || !std::isfinite(time)) return std::nullopt;
  return time;
}

bool is_constant(const fs::path& folder) { return folder.filename() == "constant"; }
bool is_instance(const fs::path& folder) { return is_constant(folder) || time_of(folder); }
bool has_constant(const fs::path& folder) { return fs::is_directory(folder / "constant"); }

/// Where a mesh stands in a case: CASE/INSTANCE/polyMesh or CASE/INSTANCE/REGION/polyMesh, the instance being constant or a time.
struct CasePlace {
  fs::path root;
  std::optional<double> time;  ///< none: constant
  fs::path region;             ///< empty without regions
};

/// The place of the folder that contains a polyMesh, an instance or a region; std::nullopt if it is not in a case.
std::optional<CasePlace> place_in_case(fs::path holder) {
  holder = fs::absolute(holder).lexically_normal();
  if (!holder.has_filename()) holder = holder.parent_path();
  const fs::path above = holder.parent_path();
  if (is_instance(holder) && has_constant(above)) return CasePlace{above, time_of(holder), {}};
  if (is_instance(above) && has_constant(above.parent_path())) {
    return CasePlace{above.parent_path(), time_of(above), holder.filename()};
  }
  return std::nullopt;
}

/// The folder that has a file of a mesh at a time, as OpenFOAM looks for it: the last time up to then that has one,
/// else constant.
std::optional<fs::path> instance_with(const CasePlace& place, const char* name) {
  std::vector<std::pair<double, fs::path>> times;
  std::error_code unreadable;
  for (const auto& entry : fs::directory_iterator(place.root, unreadable)) {
    const auto time = time_of(entry.path());
    if (time && place.time && *time <= *place.time) times.emplace_back(*time, entry.path());
  }
  std::sort(times.rbegin(), times.rend());
  times.emplace_back(0, place.root / "constant");
  for (const auto& [time, instance] : times) {
    const fs::path folder = instance / place.region / "polyMesh";
    if (existing(folder, name)) return folder;
  }
  return std::nullopt;
}

std::optional<fs::path> find_points(const fs::path& path) {
  if (fs::is_directory(path)) {
    for (const fs::path& folder : {path / "constant" / "polyMesh", path / "polyMesh", path}) {
      if (auto points = existing(folder, "points")) return points;
    }
    // A time without points of its own has those of an earlier one.
    const auto place = place_in_case(path);
    const auto folder = place ? instance_with(*place, "points") : std::nullopt;
    return folder ? existing(*folder, "points") : std::nullopt;
  }
  const fs::path name = path.filename();
  if ((name == "points" || name == "points.gz") && fs::is_regular_file(path)) return path;
  return std::nullopt;
}

/// The folder of the faces, cells and patches. A time folder may have nothing but the points that moved.
fs::path topology_folder(const fs::path& points) {
  const fs::path own = fs::absolute(points).parent_path();
  if (existing(own, "faces")) return own;
  if (const auto place = place_in_case(own.parent_path())) {
    return instance_with(*place, "faces").value_or(place->root / "constant" / place->region / "polyMesh");
  }
  return own.parent_path().parent_path() / "constant" / "polyMesh";
}

/// A case whose time has another topology, or time folders that were copied together: points of one mesh, faces of another.
void check_all_used(const MeshFile& file, const fs::path& points, const fs::path& folder) {
  const Mesh& mesh = *file.mesh();
  std::vector<char> used(mesh.point_count());
  for (const PointId p : mesh.cells->face_points) used[p] = 1;
  const auto count = static_cast<std::size_t>(std::count(used.begin(), used.end(), 1));
  if (count == used.size()) return;
  const auto own = existing(folder, "points");
  if (own && openfoam_point_count({read_file(*own), own->string()}) == used.size()) return;  // so it was before they moved
  throw Error(ErrorCode::invalid_argument, points.string() + ": has " + std::to_string(used.size()) +
                                               " points, but the faces of " + folder.string() + " use only " +
                                               std::to_string(count) + " of them: they belong to another mesh");
}

FoamFiles::Part load_if_there(const fs::path& folder, const char* name) {
  return existing(folder, name) ? load_openfoam_file(folder, name) : FoamFiles::Part{};
}

}  // namespace

bool is_openfoam(const fs::path& path) { return find_points(path).has_value(); }

FoamFiles::Part load_openfoam_file(const fs::path& folder, const char* name, const char* what) {
  const auto path = existing(folder, name);
  if (!path) {
    throw Error(ErrorCode::not_found, "cannot open " + (folder / name).string() + ", " + what);
  }
  return {read_file(*path), path->string()};
}

FoamFolder load_openfoam(const fs::path& path, const fs::path& faces_of) {
  FoamFolder loaded;
  loaded.points = find_points(path).value();
  loaded.topology = topology_folder(loaded.points);
  if (!existing(loaded.topology, "faces")) {
    if (const auto lending = faces_of.empty() ? std::nullopt : find_points(faces_of)) loaded.topology = topology_folder(*lending);
  }
  const fs::path& folder = loaded.topology;
  FoamFiles& files = loaded.files;
  files.points = {read_file(loaded.points, &loaded.compressed), loaded.points.string()};
  files.faces = load_openfoam_file(folder, "faces");
  files.owner = load_openfoam_file(folder, "owner");
  files.neighbour = load_openfoam_file(folder, "neighbour");
  files.boundary = load_openfoam_file(folder, "boundary");
  files.point_zones = load_if_there(folder, "pointZones");
  files.face_zones = load_if_there(folder, "faceZones");
  files.cell_zones = load_if_there(folder, "cellZones");
  return loaded;
}

std::unique_ptr<MeshFile> read_openfoam(const fs::path& path, const fs::path& faces_of) {
  FoamFolder loaded = load_openfoam(path, faces_of);
  auto file = parse_openfoam(std::move(loaded.files));
  file->compressed = loaded.compressed;
  if (loaded.topology != fs::absolute(loaded.points).parent_path()) check_all_used(*file, loaded.points, loaded.topology);
  return file;
}

void explain_no_mesh(const fs::path& path) {
  if (!fs::is_directory(path)) {
    if (fs::exists(path) || find_reader(path.string()) != nullptr) return;
    throw Error(ErrorCode::not_found, "cannot open " + path.string() + ": there is no such file or folder");
  }
  std::vector<std::string> regions, parts;
  std::error_code unreadable;
  for (const auto& entry : fs::directory_iterator(path / "constant", unreadable)) {
    if (existing(entry.path() / "polyMesh", "points")) regions.push_back(entry.path().string());
  }
  for (const auto& entry : fs::directory_iterator(path, unreadable)) {
    if (entry.path().filename().string().starts_with("processors")) parts.push_back(entry.path().string());
  }
  const auto listed = [](std::vector<std::string>& names) {
    constexpr std::size_t most = 10;
    std::sort(names.begin(), names.end());
    std::string all;
    for (std::size_t i = 0; i < std::min(most, names.size()); ++i) all += (i == 0 ? "" : ", ") + names[i];
    return all + (names.size() > most ? ", ..." : "");
  };
  if (!regions.empty()) {
    throw Error(ErrorCode::invalid_argument,
                path.string() + ": is an OpenFOAM case of several regions; name the one to read: " + listed(regions));
  }
  if (!parts.empty()) {
    throw Error(ErrorCode::invalid_argument,
                path.string() + ": is a decomposed OpenFOAM case without a mesh in its collated parts, " + listed(parts));
  }
  throw Error(
      ErrorCode::invalid_argument,
      path.string() +
          ": is a folder without an OpenFOAM mesh; there is no constant/polyMesh/points, polyMesh/points or points in it");
}

namespace {

[[noreturn]] void refuse_output(const fs::path& output, const std::string& reason) {
  throw Error(ErrorCode::invalid_argument, output.string() + ": " + reason);
}

bool is_part(const fs::path& root) { return root.filename().string().starts_with("processor"); }

/// The case in which a folder stands, as one of its times or under another name; empty if in none.
fs::path case_around(const fs::path& output) {
  if (const auto place = place_in_case(output)) return place->root;
  fs::path folder = fs::absolute(output).lexically_normal();
  if (!folder.has_filename()) folder = folder.parent_path();
  return has_constant(folder.parent_path()) ? folder.parent_path() : fs::path();
}

/// Points of a part of a decomposed case belong into the same part.
void check_part(const CasePlace& from, const fs::path& output, const fs::path& around) {
  if (from.root == around) return;
  const std::string hint = "; name a time folder of it, such as " + (from.root / "1" / from.region).string();
  const fs::path whole = from.root.parent_path();
  if (is_part(from.root) && (whole == around || (is_part(around) && whole == around.parent_path()))) {
    refuse_output(output, "the mesh is that of " + from.root.filename().string() + ", one part of a decomposed case" + hint);
  }
  if (is_part(around) && around.parent_path() == from.root) {
    refuse_output(output, "is in one part of a decomposed case, and the mesh is that of the whole case" + hint);
  }
}

/// OpenFOAM takes either of two folders of one time, such as 0.1 and 0.10.
void check_same_time(const fs::path& output, const CasePlace& to) {
  const fs::path instance = fs::absolute(output).lexically_normal().lexically_relative(to.root).begin()->string();
  std::error_code unreadable;
  for (const auto& entry : fs::directory_iterator(to.root, unreadable)) {
    if (time_of(entry.path()) == to.time && entry.path().filename() != instance) {
      refuse_output(output, "is the same time as " + entry.path().string() + ", which is there; write to that, or remove it");
    }
  }
}

}  // namespace

void check_openfoam_output(const fs::path& source, const fs::path& output) {
  const fs::path name = output.filename();
  if (name == "points" || name == "points.gz") return;
  const auto from = place_in_case(fs::absolute(openfoam_source_points(source)).lexically_normal().parent_path().parent_path());
  if (has_constant(output)) {
    const fs::path region = from ? from->region : fs::path();
    refuse_output(output, "is an OpenFOAM case, whose mesh in constant would not change; name a time folder of it, such as " +
                              (output / "1" / region).string());
  }
  if (replaced_openfoam_points(source, output)) return;  // another question: callers ask it
  const fs::path around = case_around(output);
  if (!from || around.empty()) return;
  check_part(*from, output, around);
  const auto to = place_in_case(output);
  if (to && to->time) check_same_time(output, *to);
  const fs::path region = to ? to->region : fs::path();
  if (from->region == region) return;
  if (from->region.empty()) {
    refuse_output(
        output, "is the folder of a region, and the mesh has no regions; name a time folder, such as " + (around / "1").string());
  }
  refuse_output(output, "the mesh is that of region " + from->region.string() +
                            "; name the folder of the region in a time, such as " + (around / "1" / from->region).string());
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
    // A case is no time folder: files written there would not be found, or be taken for its mesh.
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
