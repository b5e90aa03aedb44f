// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/openfoam/decomposed_case.h"

#include <algorithm>
#include <charconv>
#include <string>
#include <string_view>
#include <utility>

#include "core/base/error.h"
#include "core/io/formats/openfoam/openfoam_folder.h"
#include "core/io/formats/openfoam/whole_mesh.h"

namespace deform::io {

namespace {

namespace fs = std::filesystem;

constexpr const char* every_part = "processor*";

/// The number N of a folder called processorN.
std::optional<std::size_t> part_number(const fs::path& folder) {
  constexpr std::string_view prefix = "processor";
  const std::string name = folder.filename().string();
  if (!name.starts_with(prefix)) return std::nullopt;
  const char* const begin = name.data() + prefix.size();
  const char* const end = name.data() + name.size();
  std::size_t number = 0;
  const auto [stop, error] = std::from_chars(begin, end, number);
  if (error != std::errc() || stop != end || std::to_string(number) != std::string(begin, end)) return std::nullopt;
  return number;
}

std::size_t count_parts(const fs::path& root) {
  std::size_t count = 0;
  std::error_code unreadable;
  for (const auto& entry : fs::directory_iterator(root.empty() ? fs::path(".") : root, unreadable)) {
    if (part_number(entry.path()) && fs::is_directory(entry.path())) ++count;
  }
  return count;
}

/// What stands before and after processor*.
std::optional<std::pair<fs::path, fs::path>> around_pattern(const fs::path& path) {
  fs::path before, after;
  bool found = false;
  for (const fs::path& name : path) {
    if (!found && name == every_part) {
      found = true;
    } else {
      (found ? after : before) /= name;
    }
  }
  if (!found) return std::nullopt;
  return std::pair(before, after);
}

/// A case decomposed into parts whose points are written part by part.
class DecomposedFile : public MeshFile {
 public:
  DecomposedFile(std::shared_ptr<const Mesh> mesh, std::vector<CasePart> parts)
      : MeshFile(Format::openfoam, std::move(mesh)), parts_(std::move(parts)) {
    for (CasePart& part : parts_) {
      files_.push_back(make_points_file(std::move(part.mesh.points), std::move(part.point_bytes), this->mesh(), part.points));
    }
  }

  std::size_t case_parts() const override { return parts_.size(); }

  std::string with_points(std::span<const Vec3>) const override {
    throw Error(ErrorCode::failed_precondition, "a decomposed OpenFOAM case has a file of points for each of its " +
                                                    std::to_string(parts_.size()) + " parts, not one for all");
  }

  std::vector<FilePart> parts_with_points(std::span<const Vec3> points) const override {
    std::vector<FilePart> written;
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      written.push_back({"processor" + std::to_string(i), parts_[i].points_path, files_[i]->with_points(points)});
    }
    return written;
  }

 private:
  std::vector<CasePart> parts_;  // files_ refer to their points
  std::vector<std::unique_ptr<MeshFile>> files_;
};

}  // namespace

std::optional<CaseParts> case_parts(const fs::path& path) {
  CaseParts parts;
  if (const auto around = around_pattern(path)) {
    parts.root = around->first;
    parts.place = around->second;
  } else if (!is_openfoam(path) && is_openfoam(path / "processor0")) {
    parts.root = path;
  } else {
    return std::nullopt;
  }
  parts.count = count_parts(parts.root);
  if (parts.count == 0) {
    throw Error(ErrorCode::not_found, path.string() + ": there is no folder " + (parts.root / "processor0").string());
  }
  for (std::size_t i = 0; i < parts.count; ++i) {
    if (is_openfoam(parts.at(i))) continue;
    throw Error(ErrorCode::not_found, path.string() + ": no OpenFOAM mesh in " + parts.at(i).string() + "; the case has " +
                                          std::to_string(parts.count) + " folders of parts");
  }
  return parts;
}

std::unique_ptr<MeshFile> read_parts(const CaseParts& parts) {
  std::vector<CasePart> all;
  bool compressed = false;
  for (std::size_t i = 0; i < parts.count; ++i) {
    FoamFolder folder = load_openfoam(parts.at(i));
    compressed = compressed || folder.compressed;
    all.push_back(read_case_part(std::move(folder)));
  }
  auto mesh = assemble_mesh(whole_mesh(all), parts.root.string());
  auto file = std::make_unique<DecomposedFile>(std::move(mesh), std::move(all));
  file->compressed = compressed;
  return file;
}

CaseParts output_parts(const fs::path& output, std::size_t count) {
  if (auto around = around_pattern(output)) return {around->first, count, around->second};
  fs::path root = fs::absolute(output).lexically_normal();
  if (!root.has_filename()) root = root.parent_path();
  for (fs::path place; root != root.root_path(); place = root.filename() / place, root = root.parent_path()) {
    if (fs::is_directory(root / "processor0")) return {root, count, place.empty() ? place : place.lexically_normal()};
  }
  return {output, count, {}};
}

fs::path parts_source_points(const CaseParts& parts) {
  const fs::path first = fs::canonical(openfoam_source_points(parts.at(0)));
  const fs::path root = fs::canonical(parts.root.empty() ? fs::path(".") : parts.root);
  return root / every_part / first.lexically_relative(root / "processor0");
}

std::optional<fs::path> replaced_parts(const CaseParts& parts, const fs::path& output) {
  const CaseParts target = output_parts(output, parts.count);
  for (std::size_t i = 0; i < parts.count; ++i) {
    if (const auto replaced = replaced_openfoam_points(parts.at(i), target.at(i))) return replaced;
  }
  return std::nullopt;
}

void check_parts_output(const CaseParts& parts, const fs::path& output) {
  const CaseParts target = output_parts(output, parts.count);
  const std::string hint = "; name a time folder of it, such as " + (parts.root / "1").string();
  for (const fs::path& name : target.place) {
    if (!part_number(name)) continue;
    throw Error(ErrorCode::invalid_argument,
                output.string() + ": is one part of a decomposed case, and the mesh is that of all its parts" + hint);
  }
  if (target.place.empty() && (output.filename() == "points" || output.filename() == "points.gz")) {
    throw Error(ErrorCode::invalid_argument, output.string() + ": is one file, and each of the " + std::to_string(parts.count) +
                                                 " parts of the mesh has its own points" + hint);
  }
  if (target.place.empty() && fs::is_directory(target.at(0))) {
    throw Error(ErrorCode::invalid_argument,
                output.string() + ": is a decomposed OpenFOAM case, whose mesh in constant would not change" + hint);
  }
  for (std::size_t i = 0; i < parts.count; ++i) check_openfoam_output(parts.at(i), target.at(i));
}

}  // namespace deform::io
