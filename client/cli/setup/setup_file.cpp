// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/setup/setup_file.h"

#include <algorithm>
#include <cctype>
#include <iterator>
#include <memory>
#include <string_view>
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

/// The lengths of the mesh of a setup that expressions may use, read when one of them is asked for.
class MeshLengths {
 public:
  MeshLengths(const std::filesystem::path& setup, const std::string& text, const io::ReadOptions& reading)
      : setup_(setup), text_(text), reading_(reading) {}

  std::optional<double> of(std::string_view name) {
    constexpr std::string_view names[] = {"Lx", "Ly", "Lz"};
    const auto side = std::find(std::begin(names), std::end(names), name);
    if (name != "L" && side == std::end(names)) return std::nullopt;
    if (!box_) box_ = bounding_box(mesh()->points);
    return name == "L" ? box_->diagonal() : box_->side(static_cast<int>(side - std::begin(names)));
  }

 private:
  std::shared_ptr<const Mesh> mesh() const {
    const std::string geometry = top_level_text(text_, "geometry");
    const std::filesystem::path path = setup_.parent_path() / geometry;
    if (geometry.empty() || !std::filesystem::exists(path)) {
      throw Error(ErrorCode::invalid_argument, "L, Lx, Ly and Lz are the lengths of the mesh, and `geometry` names no mesh file");
    }
    return io::read_mesh_file(path, reading_)->mesh();
  }

  const std::filesystem::path& setup_;
  const std::string& text_;
  const io::ReadOptions& reading_;
  std::optional<Box> box_;
};

/// What the file says, with the files that values come from.
v1::Setup parsed_file(const std::filesystem::path& path, Problems& problems, const io::ReadOptions& reading) {
  constexpr std::size_t max_bytes = std::size_t{1} << 26;
  const std::string text = io::read_file(path, nullptr, max_bytes);
  IdFiles id_files(path.parent_path());
  MeshLengths lengths(path, text, reading);
  const ValueFiles files{[&](const std::string& name, const std::string& set) { return id_files.ids(name, set); },
                         [&](const std::string& name) { return read_control_points(path.parent_path() / name); },
                         [&](std::string_view name) { return lengths.of(name); }};
  v1::Setup setup;
  parse_yaml(text, path.string(), setup, files, problems);
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
  const v1::Setup setup = parsed_file(path, problems, {});
  std::vector<const google::protobuf::FieldDescriptor*> fields;
  setup.GetReflection()->ListFields(setup, &fields);
  for (const auto* field : fields) {
    if (field->name() == "method") continue;
    throw Error(ErrorCode::invalid_argument,
                path.string() + ": " + field->name() + ": unexpected in a file that names a method only");
  }
  if (setup.method().kind_case() == v1::Method::KIND_NOT_SET) {
    throw Error(ErrorCode::invalid_argument, path.string() + ": method: missing, expected such as method: {shell: {}}");
  }
  return setup.method();
}

SetupFile read_setup_file(const std::filesystem::path& path, const io::ReadOptions& reading) {
  Problems problems(Problems::Mode::throw_first);
  return read_setup_file(path, problems, reading);
}

SetupFile read_setup_file(const std::filesystem::path& path, Problems& problems, const io::ReadOptions& reading) {
  SetupFile file{parsed_file(path, problems, reading), std::nullopt};
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
