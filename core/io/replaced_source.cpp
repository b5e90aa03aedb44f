// SPDX-License-Identifier: Apache-2.0
#include <optional>

#include "core/io/formats/openfoam/decomposed_case.h"
#include "core/io/formats/openfoam/openfoam_folder.h"
#include "core/io/gzip.h"
#include "core/io/mesh_file.h"

namespace deform::io {

namespace {

namespace fs = std::filesystem;

/// Whether two names refer to the same file, including hard and symbolic links. False if either does not exist.
bool same(const fs::path& a, const fs::path& b) {
  std::error_code missing;
  return fs::equivalent(a, b, missing) && !missing;
}

/// The same name but for the .gz at its end.
fs::path packed_or_not(const fs::path& path) {
  const std::string name = path.string();
  return has_gzip_extension(name) ? fs::path(name.substr(0, name.size() - 3)) : fs::path(name + ".gz");
}

}  // namespace

std::optional<fs::path> replaced_source(const fs::path& source, const fs::path& output) {
  if (const auto parts = case_parts(source)) return replaced_parts(*parts, output);
  if (is_openfoam(source)) return replaced_openfoam_points(source, output);
  if (same(source, output) || same(source, packed_or_not(output))) return source;
  return std::nullopt;
}

void check_output(const fs::path& source, const fs::path& output) {
  if (const auto parts = case_parts(source)) return check_parts_output(*parts, output);
  if (is_openfoam(source)) check_openfoam_output(source, output);
}

bool mesh_exists(const fs::path& path) { return fs::is_regular_file(path) || fs::is_directory(path) || case_parts(path); }

fs::path source_file(const fs::path& source) {
  if (const auto parts = case_parts(source)) return parts_source_points(*parts);
  return fs::canonical(is_openfoam(source) ? openfoam_source_points(source) : source);
}

}  // namespace deform::io
