// SPDX-License-Identifier: Apache-2.0
#include "client/setup/setup_file.h"

#include <algorithm>
#include <cctype>

#include "client/setup/cage_file.h"
#include "client/setup/control_points.h"
#include "client/setup/id_files.h"
#include "client/setup/yaml_message.h"
#include "core/base/error.h"
#include "core/io/mesh_file.h"

namespace deform::client {

bool looks_like_id(const std::string& text) {
  return text.size() >= 8 && text.size() <= 64 &&
         std::all_of(text.begin(), text.end(), [](unsigned char c) { return std::isxdigit(c) != 0; });
}

SetupFile read_setup_file(const std::filesystem::path& path) {
  Problems problems(Problems::Mode::throw_first);
  return read_setup_file(path, problems);
}

SetupFile read_setup_file(const std::filesystem::path& path, Problems& problems) {
  constexpr std::size_t max_bytes = std::size_t{1} << 26;
  return parse_setup(io::read_file(path, nullptr, max_bytes), path.string(), path.parent_path(), GeometryEntry::needed, problems);
}

namespace {

void take_geometry(const std::string& name, const std::filesystem::path& folder, SetupFile& file, Problems& problems) {
  const std::string geometry = file.setup.geometry();
  const bool given = problems.check("geometry", [&] {
    if (!geometry.empty()) return;
    throw Error(ErrorCode::invalid_argument, name + ": geometry: missing, expected a mesh file or a geometry id");
  });
  if (!given) return;
  const std::filesystem::path mesh = folder / geometry;
  if (std::filesystem::is_regular_file(mesh) || std::filesystem::is_directory(mesh)) {
    file.geometry_file = mesh;
    file.setup.clear_geometry();
  } else if (!looks_like_id(geometry)) {
    problems.check("geometry", [&] {
      throw Error(ErrorCode::not_found, name + ": geometry: there is no file " + mesh.string() + ", and \"" + geometry +
                                            "\" is no geometry id (8 to 64 hexadecimal digits)");
    });
  }
}

}  // namespace

SetupFile parse_setup(const std::string& text, const std::string& name, const std::filesystem::path& folder,
                      GeometryEntry geometry, Problems& problems) {
  SetupFile file;
  IdFiles id_files(folder);
  const ValueFiles files{[&](const std::string& named, const std::string& set) { return id_files.ids(named, set); },
                         [&](const std::string& named) { return read_control_points(folder / named); }};
  parse_yaml(text, name, file.setup, files, problems);
  if (!problems.concern("method")) {  // a method that cannot be read lacks no file
    problems.check("method", [&] {
      try {
        read_cage(folder, file.setup);
      } catch (const Error& error) {
        throw Error(error.code(), name + ": " + error.what());
      }
    });
  }
  if (geometry == GeometryEntry::needed) {
    take_geometry(name, folder, file, problems);
  } else {
    file.setup.clear_geometry();
  }
  return file;
}

}  // namespace deform::client
