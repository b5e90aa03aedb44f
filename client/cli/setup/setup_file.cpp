// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/setup/setup_file.h"

#include <algorithm>
#include <cctype>
#include <vector>

#include "client/cli/setup/cage_file.h"
#include "client/cli/setup/control_lattice.h"
#include "client/cli/setup/id_files.h"
#include "client/cli/setup/yaml_message.h"
#include "core/base/error.h"
#include "core/io/mesh_file.h"

namespace deform::cli {

bool looks_like_id(const std::string& text) {
  return text.size() >= 8 && text.size() <= 64 &&
         std::all_of(text.begin(), text.end(), [](unsigned char c) { return std::isxdigit(c) != 0; });
}

namespace {

/// What the file says, with the files that values come from.
v1::Setup parsed_file(const std::filesystem::path& path, Problems& problems) {
  constexpr std::size_t max_bytes = std::size_t{1} << 26;
  IdFiles id_files(path.parent_path());
  const ValueFiles files{[&](const std::string& name, const std::string& set) { return id_files.ids(name, set); },
                         [&](const std::string& name) { return read_control_points(path.parent_path() / name); }};
  v1::Setup setup;
  parse_yaml(io::read_file(path, nullptr, max_bytes), path.string(), setup, files, problems);
  problems.check("method", [&] {
    try {
      read_cage(path.parent_path(), setup);
    } catch (const Error& error) {
      throw Error(error.code(), path.string() + ": " + error.what());
    }
  });
  return setup;
}

}  // namespace

v1::Method read_method_file(const std::filesystem::path& path) {
  Problems problems(Problems::Mode::throw_first);
  const v1::Setup setup = parsed_file(path, problems);
  std::vector<const google::protobuf::FieldDescriptor*> fields;
  setup.GetReflection()->ListFields(setup, &fields);
  for (const auto* field : fields) {
    if (field->name() == "method") continue;
    throw Error(ErrorCode::invalid_argument, path.string() + ": " + field->name() + ": unexpected in a file that names a method only");
  }
  if (setup.method().kind_case() == v1::Method::KIND_NOT_SET) {
    throw Error(ErrorCode::invalid_argument, path.string() + ": method: missing, expected such as method: {shell: {}}");
  }
  return setup.method();
}

SetupFile read_setup_file(const std::filesystem::path& path) {
  Problems problems(Problems::Mode::throw_first);
  return read_setup_file(path, problems);
}

SetupFile read_setup_file(const std::filesystem::path& path, Problems& problems) {
  SetupFile file{parsed_file(path, problems), std::nullopt};
  const std::string geometry = file.setup.geometry();
  const bool given = problems.check("geometry", [&] {
    if (!geometry.empty()) return;
    throw Error(ErrorCode::invalid_argument, path.string() + ": geometry: missing, expected a mesh file or a geometry id");
  });
  if (!given) return file;
  const std::filesystem::path mesh = path.parent_path() / geometry;
  if (std::filesystem::is_regular_file(mesh) || std::filesystem::is_directory(mesh)) {
    file.geometry_file = mesh;
    file.setup.clear_geometry();
  } else if (!looks_like_id(geometry)) {
    problems.check("geometry", [&] {
      throw Error(ErrorCode::not_found, path.string() + ": geometry: there is no file " + mesh.string() + ", and \"" + geometry +
                                            "\" is no geometry id (8 to 64 hexadecimal digits)");
    });
  }
  return file;
}

}  // namespace deform::cli
