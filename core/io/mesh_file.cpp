#include "core/io/mesh_file.h"

#include <algorithm>

#include "core/base/error.h"
#include "core/io/file_format.h"
#include "core/io/gzip.h"
#include "core/io/readers.h"

namespace deform::io {

namespace {

constexpr std::size_t max_unpacked = std::size_t{1} << 36;

std::string lower_case(std::string text) {
  for (char& c : text) {
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  }
  return text;
}

/// The file itself last: when it is there, all is.
void write_parts(const std::vector<MeshFile::FilePart>& parts, const std::filesystem::path& path) {
  std::vector<std::pair<std::filesystem::path, const std::string*>> targets;
  for (std::size_t i = 1; i < parts.size(); ++i) {
    const std::filesystem::path target = path.parent_path() / parts[i].path;
    std::error_code none;
    if (std::filesystem::equivalent(path, parts[i].original, none)) {
      throw Error(ErrorCode::failed_precondition,
                  path.string() + ": the mesh that was read includes this file; write to another");
    }
    if (!std::filesystem::equivalent(target, parts[i].original, none)) {
      targets.emplace_back(target, &parts[i].bytes);
    } else if (read_file(target) != parts[i].bytes) {
      throw Error(ErrorCode::failed_precondition, path.string() + ": " + target.string() +
                                                      ", which it includes, is the file that was read and has other points; " +
                                                      "write to another folder");
    }
  }
  for (const auto& [target, bytes] : targets) {
    if (target.has_parent_path()) std::filesystem::create_directories(target.parent_path());
    write_file(target, *bytes);
  }
  write_file(path, parts[0].bytes);
}

}  // namespace

bool has_gzip_extension(const std::string& name) { return lower_case(name).ends_with(".gz"); }

Format format_of(const std::string& name) {
  std::string plain = lower_case(name);
  if (plain.ends_with(".gz")) plain.resize(plain.size() - 3);
  if (plain.ends_with(".obj")) return Format::obj;
  if (plain.ends_with(".off")) return Format::off;
  if (plain.ends_with(".ply")) return Format::ply;
  if (plain.ends_with(".stl")) return Format::stl;
  if (plain.ends_with(".mesh")) return Format::medit;
  if (plain.ends_with(".inp")) return Format::abaqus;
  if (plain.ends_with(".msh")) return Format::gmsh;
  if (plain.ends_with(".bdf") || plain.ends_with(".nas") || plain.ends_with(".dat")) return Format::nastran;
  if (plain.ends_with(".su2")) return Format::su2;
  if (plain.ends_with(".vtk")) return Format::vtk;
  if (plain.ends_with(".vtu")) return Format::vtu;
  if (plain.ends_with(".vtp")) return Format::vtp;
  if (plain.ends_with(".cgns")) return Format::cgns;
  for (const char* extension : {".e", ".exo", ".ex2", ".g"}) {
    if (plain.ends_with(extension)) return Format::exodus;
  }
  if (plain == "points" || plain.ends_with("/points")) return Format::openfoam;
  throw Error(ErrorCode::invalid_argument, name +
                                               ": unknown mesh format, expected a name that ends in .obj, .off, .ply, .stl, "
                                               ".mesh, .su2, .vtk, .vtu, .vtp, .cgns, .e, .exo, .ex2, .g, .msh, .inp, .bdf, .nas "
                                               "or .dat (optionally .gz), or the folder of "
                                               "an OpenFOAM mesh");
}

const char* to_string(Format format) {
  switch (format) {
    case Format::obj:
      return "OBJ";
    case Format::off:
      return "OFF";
    case Format::ply:
      return "PLY";
    case Format::stl:
      return "STL";
    case Format::openfoam:
      return "OpenFOAM";
    case Format::medit:
      return "Medit";
    case Format::gmsh:
      return "Gmsh";
    case Format::abaqus:
      return "Abaqus";
    case Format::nastran:
      return "Nastran";
    case Format::su2:
      return "SU2";
    case Format::vtk:
      return "VTK";
    case Format::vtu:
      return "VTU";
    case Format::vtp:
      return "VTP";
    case Format::cgns:
      return "CGNS";
    case Format::exodus:
      return "Exodus";
  }
  return "unknown";
}

std::unique_ptr<MeshFile> parse_mesh(std::string bytes, const std::string& name, const ReadOptions& options) {
  const Format format = format_of(name);
  const bool compressed = is_gzip(bytes);
  if (compressed) bytes = gunzip(bytes, name, max_unpacked);
  std::unique_ptr<MeshFile> file;
  switch (format) {
    case Format::obj:
      file = parse_obj(std::move(bytes), name);
      break;
    case Format::off:
      file = parse_off(std::move(bytes), name);
      break;
    case Format::ply:
      file = parse_ply(std::move(bytes), name);
      break;
    case Format::stl:
      file = parse_stl(std::move(bytes), name);
      break;
    case Format::medit:
      file = parse_medit(std::move(bytes), name);
      break;
    case Format::abaqus:
      file = parse_abaqus(std::move(bytes), name);
      break;
    case Format::gmsh:
      file = parse_gmsh(std::move(bytes), name);
      break;
    case Format::nastran:
      file = parse_nastran(std::move(bytes), name);
      break;
    case Format::su2:
      file = parse_su2(std::move(bytes), name);
      break;
    case Format::vtk:
      file = parse_vtk(std::move(bytes), name);
      break;
    case Format::vtu:
      file = parse_vtu(std::move(bytes), name);
      break;
    case Format::vtp:
      file = parse_vtp(std::move(bytes), name);
      break;
    case Format::cgns:
    case Format::exodus:
      file = parse_container(format, std::move(bytes), name, options);
      break;
    case Format::openfoam:
      throw Error(ErrorCode::invalid_argument, name + ": points alone are no mesh, the files beside them are needed");
  }
  file->compressed = compressed;
  return file;
}

std::unique_ptr<MeshFile> read_mesh_file(const std::filesystem::path& path, const ReadOptions& options) {
  if (is_openfoam(path)) return read_openfoam(path);
  const Format format = format_of(path.string());  // a name that cannot be read is refused before its bytes are
  bool compressed = false;
  std::string bytes = read_file(path, &compressed);
  auto file =
      format == Format::abaqus ? read_abaqus(std::move(bytes), path) : parse_mesh(std::move(bytes), path.string(), options);
  file->compressed = compressed;
  return file;
}

void write_mesh_file(const MeshFile& source, std::span<const Vec3> points, const std::filesystem::path& path) {
  if (source.format() == Format::openfoam) {
    const std::filesystem::path points_path = openfoam_points_path(path);
    if (points_path.has_parent_path()) std::filesystem::create_directories(points_path.parent_path());
    return write_file(points_path, source.with_points(points));
  }
  const Format format = format_of(path.string());
  if (format != source.format()) {
    throw Error(ErrorCode::invalid_argument, path.string() + ": the source is an " + to_string(source.format()) +
                                                 " file and can only be written as one, not as " + to_string(format));
  }
  write_parts(source.parts_with_points(points), path);
}

}  // namespace deform::io
