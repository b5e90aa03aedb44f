// SPDX-License-Identifier: Apache-2.0
#include "core/io/mesh_file.h"

#include <algorithm>

#include "core/base/error.h"
#include "core/io/formats/containers/container_mesh.h"
#include "core/io/formats/openfoam/decomposed_case.h"
#include "core/io/formats/openfoam/openfoam_folder.h"
#include "core/io/gzip.h"
#include "core/io/readers.h"
#include "core/mesh/coordinate_limits.h"

namespace deform::io {

namespace {

constexpr std::size_t max_unpacked = std::size_t{1} << 36;

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

/// The same points in the other form, compressed or not, are removed, as OpenFOAM does: of two it would read the one that is not.
void write_foam_points(const std::filesystem::path& path, const std::string& bytes) {
  if (path.has_parent_path()) std::filesystem::create_directories(path.parent_path());
  write_file(path, bytes);
  const bool compressed = path.extension() == ".gz";
  const std::filesystem::path other =
      compressed ? path.parent_path() / path.stem() : std::filesystem::path(path.string() + ".gz");
  std::error_code absent;
  std::filesystem::remove(other, absent);
}

void write_case_parts(const std::vector<MeshFile::FilePart>& parts, const std::filesystem::path& path) {
  CaseParts folders;
  folders.count = parts.size();
  if (parts.front().path != folders.folder(0)) {
    for (const MeshFile::FilePart& part : parts) folders.collated.push_back({part.path.string(), 0, 0});
  }
  const CaseParts target = output_parts(path, std::move(folders));
  for (std::size_t k = 0; k < parts.size(); ++k) write_foam_points(openfoam_points_path(target.at(k)), parts[k].bytes);
}

}  // namespace

std::unique_ptr<MeshFile> parse_mesh(std::string bytes, const std::string& name, const ReadOptions& options) {
  const Reader& reader = reader_of(name);
  const bool compressed = is_gzip(bytes);
  if (compressed) bytes = gunzip(bytes, name, max_unpacked);
  const auto parse = options.turn_normals && reader.parse_turning_normals ? reader.parse_turning_normals : reader.parse;
  std::unique_ptr<MeshFile> file =
      reader.library ? parse_container(reader, std::move(bytes), name, options) : parse(std::move(bytes), name);
  check_coordinates(file->mesh()->points, name + ": points");
  file->compressed = compressed;
  return file;
}

std::unique_ptr<MeshFile> read_mesh_file(const std::filesystem::path& path, const ReadOptions& options) {
  if (const auto parts = case_parts(path)) return read_parts(*parts);
  if (is_openfoam(path)) return read_openfoam(path, options.faces_of);
  explain_no_mesh(path);
  const Reader& reader = reader_of(path.string());  // a name that cannot be read is refused before its bytes are
  bool compressed = false;
  std::string bytes = read_file(path, &compressed);
  auto file = reader.parse_with_includes ? reader.parse_with_includes(std::move(bytes), path)
                                         : parse_mesh(std::move(bytes), path.string(), options);
  file->compressed = compressed;
  return file;
}

void write_mesh_file(const MeshFile& source, std::span<const Vec3> points, const std::filesystem::path& path) {
  if (source.format() == Format::openfoam) {
    if (source.case_parts() > 0) return write_case_parts(source.parts_with_points(points), path);
    return write_foam_points(openfoam_points_path(path), source.with_points(points));
  }
  const Reader& reader = reader_of(path.string());
  if (reader.format != source.format()) {
    throw Error(ErrorCode::invalid_argument, path.string() + ": the source is an " + reader_of(source.format()).name +
                                                 " file and can only be written as one, not as " + reader.name);
  }
  write_parts(source.parts_with_points(points), path);
}

void write_new_file(const Mesh& mesh, const std::filesystem::path& path) {
  const Reader* reader = find_reader(path.string());
  mesh.validate();
  if (reader != nullptr && reader->new_file) return write_file(path, reader->new_file(mesh, path.string()));
  std::string known;
  for (const Reader& other : readers()) {
    if (other.new_file) known += (known.empty() ? "" : " or ") + other.extensions.front();
  }
  throw Error(ErrorCode::invalid_argument, path.string() + ": new files are written as " + known + ", optionally with .gz" +
                                               (reader != nullptr ? ", not as " + reader->name : ""));
}

}  // namespace deform::io
