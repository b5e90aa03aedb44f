// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/openfoam/decomposed_case.h"

#include <algorithm>
#include <charconv>
#include <iterator>
#include <map>
#include <string>
#include <string_view>
#include <utility>

#include "core/base/error.h"
#include "core/io/formats/openfoam/collated_file.h"
#include "core/io/formats/openfoam/openfoam_folder.h"
#include "core/io/formats/openfoam/whole_mesh.h"

namespace deform::io {

namespace {

namespace fs = std::filesystem;

constexpr const char* every_part = "processor*";

/// The number at the front of the text, which is shortened by it; without signs and leading zeros.
std::optional<std::size_t> take_number(std::string_view& text) {
  std::size_t number = 0;
  const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  const std::string_view digits(text.data(), static_cast<std::size_t>(stop - text.data()));
  if (error != std::errc() || std::to_string(number) != digits) return std::nullopt;
  text.remove_prefix(digits.size());
  return number;
}

bool take(std::string_view& text, std::string_view prefix) {
  if (!text.starts_with(prefix)) return false;
  text.remove_prefix(prefix.size());
  return true;
}

/// The number N of a folder called processorN.
std::optional<std::size_t> part_number(const fs::path& folder) {
  const std::string name = folder.filename().string();
  std::string_view rest = name;
  if (!take(rest, "processor")) return std::nullopt;
  const auto number = take_number(rest);
  return rest.empty() ? number : std::nullopt;
}

/// A folder called processorsN or processorsN_FIRST-LAST.
struct CollatedFolder {
  std::size_t parts = 0;  ///< N
  CaseParts::Collated folder;
};
std::optional<CollatedFolder> collated_folder(const fs::path& path) {
  const std::string name = path.filename().string();
  std::string_view rest = name;
  if (!take(rest, "processors")) return std::nullopt;
  const auto parts = take_number(rest);
  if (!parts || *parts == 0) return std::nullopt;
  if (rest.empty()) return CollatedFolder{*parts, {name, 0, *parts}};
  if (!take(rest, "_")) return std::nullopt;
  const auto first = take_number(rest);
  if (!first || !take(rest, "-")) return std::nullopt;
  const auto last = take_number(rest);
  if (!last || !rest.empty() || *last < *first || *last >= *parts) return std::nullopt;
  return CollatedFolder{*parts, {name, *first, *last - *first + 1}};
}

std::vector<fs::path> folders_in(const fs::path& root) {
  std::vector<fs::path> folders;
  std::error_code unreadable;
  for (const auto& entry : fs::directory_iterator(root.empty() ? fs::path(".") : root, unreadable)) {
    if (fs::is_directory(entry.path())) folders.push_back(entry.path());
  }
  return folders;
}

std::size_t count_parts(const fs::path& root) {
  const std::vector<fs::path> folders = folders_in(root);
  return static_cast<std::size_t>(
      std::count_if(folders.begin(), folders.end(), [](const fs::path& folder) { return part_number(folder); }));
}

/// The folders of collated parts of a case, of `wanted` parts if that is not 0; empty if there are none.
std::vector<CaseParts::Collated> collated_parts(const fs::path& root, std::size_t wanted) {
  std::map<std::size_t, std::vector<CaseParts::Collated>> found;  // by the number of parts
  for (const fs::path& path : folders_in(root)) {
    const auto folder = collated_folder(path);
    if (folder && (wanted == 0 || folder->parts == wanted)) found[folder->parts].push_back(folder->folder);
  }
  if (found.empty()) return {};
  if (found.size() > 1) {
    throw Error(ErrorCode::invalid_argument, root.string() + ": was decomposed into several numbers of parts, " +
                                                 found.begin()->second.front().name + " and " +
                                                 std::next(found.begin())->second.front().name + "; name one of them");
  }
  auto& [parts, folders] = *found.begin();
  std::sort(folders.begin(), folders.end(),
            [](const auto& a, const auto& b) { return std::pair(a.first, b.count) < std::pair(b.first, a.count); });
  if (folders.front().count == parts) folders.resize(1);
  std::size_t next = 0;
  const auto follows = [&](const CaseParts::Collated& folder) {
    const bool does = folder.first == next;
    next += does ? folder.count : 0;
    return does;
  };
  if (!std::all_of(folders.begin(), folders.end(), follows) || next != parts) {
    throw Error(ErrorCode::not_found, root.string() + ": part " + std::to_string(next) + " of the " + std::to_string(parts) +
                                          " is in no folder, or in several");
  }
  return std::move(folders);
}

/// What stands before and after the first name that is processor* or one that `parts` accepts, and that name.
struct Around {
  fs::path before, name, after;
};
template <typename Parts>
std::optional<Around> around_parts(const fs::path& path, const Parts& parts) {
  Around around;
  for (const fs::path& name : path) {
    if (!around.name.empty()) {
      around.after /= name;
    } else if (name == every_part || parts(name)) {
      around.name = name;
    } else {
      around.before /= name;
    }
  }
  if (around.name.empty()) return std::nullopt;
  return around;
}

/// A case decomposed into parts whose points are written part by part.
class DecomposedFile : public MeshFile {
 public:
  /// collated: the files of points of its folders, none if each part has one.
  DecomposedFile(std::shared_ptr<const Mesh> mesh, std::vector<CasePart> parts, const CaseParts& from,
                 std::vector<CollatedFile> collated)
      : MeshFile(Format::openfoam, std::move(mesh)), parts_(std::move(parts)), from_(from), collated_(std::move(collated)) {
    for (CasePart& part : parts_) {
      files_.push_back(make_points_file(std::move(part.mesh.points), std::move(part.point_bytes), this->mesh(), part.points));
    }
  }

  std::size_t case_parts() const override { return parts_.size(); }

  std::string with_points(std::span<const Vec3>) const override {
    throw Error(ErrorCode::failed_precondition, "a decomposed OpenFOAM case has the points of each of its " +
                                                    std::to_string(parts_.size()) + " parts, not one file for all");
  }

  std::vector<FilePart> parts_with_points(std::span<const Vec3> points) const override {
    std::vector<FilePart> written;
    for (std::size_t k = 0; k < from_.folders(); ++k) {
      if (collated_.empty()) {
        written.push_back({from_.folder(k), parts_[k].points_path, files_[k]->with_points(points)});
        continue;
      }
      const CaseParts::Collated& folder = from_.collated[k];
      std::vector<std::string> blocks;
      for (std::size_t i = 0; i < folder.count; ++i) blocks.push_back(files_[folder.first + i]->with_points(points));
      written.push_back({folder.name, from_.at(k), collated_[k].with_parts(blocks)});
    }
    return written;
  }

 private:
  std::vector<CasePart> parts_;  // files_ refer to their points
  std::vector<std::unique_ptr<MeshFile>> files_;
  const CaseParts from_;
  std::vector<CollatedFile> collated_;
};

/// The parts in one folder, and its file of points.
CollatedFile read_collated(const FoamFolder& folder, const CaseParts::Collated& parts, std::vector<CasePart>& all) {
  const auto collated = [&](const FoamFiles::Part& file) {
    return file.bytes.empty() ? CollatedFile() : CollatedFile(file, parts.count);
  };
  const CaseAddresses addresses = load_addresses(folder);
  using File = FoamFiles::Part FoamFiles::*;
  constexpr File files[] = {&FoamFiles::points,   &FoamFiles::faces,       &FoamFiles::owner,      &FoamFiles::neighbour,
                            &FoamFiles::boundary, &FoamFiles::point_zones, &FoamFiles::face_zones, &FoamFiles::cell_zones};
  std::vector<CollatedFile> opened;
  for (const File file : files) opened.push_back(collated(folder.files.*file));
  const CollatedFile of_points = collated(addresses.points), of_faces = collated(addresses.faces),
                     of_cells = collated(addresses.cells);
  for (std::size_t i = 0; i < parts.count; ++i) {
    const std::size_t number = parts.first + i;
    FoamFiles own;
    for (std::size_t k = 0; k < opened.size(); ++k) {
      if (!(folder.files.*files[k]).bytes.empty()) own.*files[k] = opened[k].part(i, number);
    }
    all.push_back(
        parse_case_part(std::move(own), {of_points.part(i, number), of_faces.part(i, number), of_cells.part(i, number)}));
  }
  return std::move(opened.front());
}

}  // namespace

namespace {

/// CASE/processor*/PLACE for a CASE/PLACE that is not there, but in the parts of the case: what output_parts() writes for it.
std::optional<fs::path> place_in_parts(const fs::path& path) {
  fs::path root = path.lexically_normal(), place;
  if (!root.has_filename()) root = root.parent_path();
  for (int names = 0; names < 2 && root.has_filename(); ++names) {  // a time, and a region in it
    place = place.empty() ? root.filename() : root.filename() / place;
    root = root.parent_path();
    for (const fs::path& folder : folders_in(root)) {
      const bool part = part_number(folder) || collated_folder(folder);
      if (part && fs::is_directory(folder / place)) return root / every_part / place;
    }
  }
  return std::nullopt;
}

}  // namespace

std::optional<CaseParts> case_parts(const fs::path& path) {
  if (!fs::exists(path)) {
    if (const auto place = place_in_parts(path)) return case_parts(*place);
  }
  CaseParts parts;
  if (const auto around = around_parts(path, [](const fs::path& name) { return collated_folder(name).has_value(); })) {
    parts.root = around->before;
    parts.place = around->after;
    const auto collated = collated_folder(around->name);
    if (!collated) parts.count = count_parts(parts.root);
    if (parts.count == 0) parts.collated = collated_parts(parts.root, collated ? collated->parts : 0);
  } else if (is_openfoam(path) || !fs::is_directory(path)) {
    return std::nullopt;
  } else if (is_openfoam(path / "processor0")) {
    parts.root = path;
    parts.count = count_parts(path);
  } else {
    parts.root = path;
    parts.collated = collated_parts(path, 0);
    if (parts.collated.empty() || !is_openfoam(parts.at(0))) return std::nullopt;
  }
  for (const CaseParts::Collated& folder : parts.collated) parts.count += folder.count;
  if (parts.count == 0) {
    throw Error(ErrorCode::not_found, path.string() + ": there is no folder " + (parts.root / "processor0").string());
  }
  for (std::size_t k = 0; k < parts.folders(); ++k) {
    if (is_openfoam(parts.at(k))) continue;
    throw Error(ErrorCode::not_found, path.string() + ": no OpenFOAM mesh in " + parts.at(k).string() + "; the case has " +
                                          std::to_string(parts.folders()) + " folders of parts");
  }
  return parts;
}

std::unique_ptr<MeshFile> read_parts(const CaseParts& parts) {
  std::vector<CasePart> all;
  std::vector<CollatedFile> collated;
  bool compressed = false;
  for (std::size_t k = 0; k < parts.folders(); ++k) {
    FoamFolder folder = load_openfoam(parts.at(k));
    compressed = compressed || folder.compressed;
    if (parts.collated.empty()) {
      all.push_back(read_case_part(std::move(folder)));
    } else {
      collated.push_back(read_collated(folder, parts.collated[k], all));
    }
  }
  auto mesh = assemble_mesh(whole_mesh(all), parts.root.string());
  auto file = std::make_unique<DecomposedFile>(std::move(mesh), std::move(all), parts, std::move(collated));
  file->compressed = compressed;
  return file;
}

CaseParts output_parts(const fs::path& output, CaseParts parts) {
  const auto named = [&](const fs::path& name) {
    return std::any_of(parts.collated.begin(), parts.collated.end(), [&](const auto& folder) { return name == folder.name; });
  };
  parts.root = output;
  parts.place.clear();
  if (auto around = around_parts(output, named)) {
    parts.root = around->before;
    parts.place = around->after;
    return parts;
  }
  fs::path root = fs::absolute(output).lexically_normal();
  if (!root.has_filename()) root = root.parent_path();
  for (fs::path place; root != root.root_path(); place = root.filename() / place, root = root.parent_path()) {
    if (!fs::is_directory(root / parts.folder(0))) continue;
    parts.root = root;
    parts.place = place.empty() ? place : place.lexically_normal();
    break;
  }
  return parts;
}

fs::path parts_source_points(const CaseParts& parts) {
  const fs::path first = fs::canonical(openfoam_source_points(parts.at(0)));
  const fs::path root = fs::canonical(parts.root.empty() ? fs::path(".") : parts.root);
  return root / every_part / first.lexically_relative(root / parts.folder(0));
}

std::optional<fs::path> replaced_parts(const CaseParts& parts, const fs::path& output) {
  const CaseParts target = output_parts(output, parts);
  for (std::size_t k = 0; k < parts.folders(); ++k) {
    if (const auto replaced = replaced_openfoam_points(parts.at(k), target.at(k))) return replaced;
  }
  return std::nullopt;
}

void check_parts_output(const CaseParts& parts, const fs::path& output) {
  const CaseParts target = output_parts(output, parts);
  const std::string hint = "; name a time folder of it, such as " + (parts.root / "1").string();
  for (const fs::path& name : target.place) {
    if (!part_number(name) && !collated_folder(name)) continue;
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
  for (std::size_t k = 0; k < parts.folders(); ++k) check_openfoam_output(parts.at(k), target.at(k));
}

}  // namespace deform::io
