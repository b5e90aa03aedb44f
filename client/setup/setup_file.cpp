// SPDX-License-Identifier: Apache-2.0
#include "client/setup/setup_file.h"

#include <algorithm>
#include <cctype>
#include <iterator>
#include <memory>
#include <string_view>
#include <vector>

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

std::optional<double> mesh_length(std::string_view name, const Box& box) {
  if (name == "L") return box.diagonal();
  constexpr std::string_view sides[] = {"Lx", "Ly", "Lz"};
  const auto side = std::find(std::begin(sides), std::end(sides), name);
  if (side == std::end(sides)) return std::nullopt;
  return box.side(static_cast<int>(side - std::begin(sides)));
}

namespace {

/// The mesh of a setup, and its lengths that expressions may use. It is read when it is first needed.
class SetupMesh {
 public:
  explicit SetupMesh(const SetupText& from) : from_(from), mesh_(from.mesh) {}

  std::optional<double> length(std::string_view name) {
    if (!mesh_length(name, Box{})) return std::nullopt;
    if (!box_) box_ = bounding_box(mesh("L, Lx, Ly and Lz are lengths of the mesh", "give the number")->points);
    return mesh_length(name, *box_);
  }

  /// `use` and `instead` are for errors: what it is for, and what to do where it is not known.
  std::shared_ptr<const Mesh> mesh(const std::string& use, const std::string& instead) {
    if (mesh_ != nullptr) return mesh_;
    if (from_.geometry == GeometryEntry::left_out) {
      throw Error(ErrorCode::invalid_argument, use + ", which is not known here; " + instead);
    }
    const std::string geometry = top_level_text(from_.text, "geometry");
    const std::filesystem::path path = from_.folder / geometry;
    if (geometry.empty() || !io::mesh_exists(path)) {
      throw Error(ErrorCode::invalid_argument, use + ", and `geometry` names no mesh file; " + instead);
    }
    mesh_ = io::read_mesh_file(path, from_.reading)->mesh();
    return mesh_;
  }

 private:
  const SetupText& from_;
  std::optional<Box> box_;
  std::shared_ptr<const Mesh> mesh_;
};

/// The setup as the text has it, with the values that come from other files.
v1::Setup parsed_text(const SetupText& from, std::vector<std::filesystem::path>& read, Problems& problems) {
  IdFiles id_files(from.folder);
  SetupMesh of_setup(from);
  const ValueFiles files{[&](const std::string& file, const std::string& set) {
                           read.push_back(from.folder / file);
                           return id_files.ids(file, set);
                         },
                         [&](const std::string& file) {
                           read.push_back(from.folder / file);
                           return read_control_points(from.folder / file);
                         },
                         [&](std::string_view name) { return of_setup.length(name); }};
  v1::Setup setup;
  parse_yaml(from.text, from.name, setup, files, problems);
  const auto fill = [&](const std::string& prefix, v1::Method& method) {
    if (problems.concern(prefix + "method")) return;  // a method that cannot be read lacks no file
    problems.check(prefix + "method", [&] {
      if (!method.cage().file().empty()) read.push_back(from.folder / method.cage().file());
      try {
        fill_cage(
            from.folder, prefix + "method.cage",
            [&] {
              return of_setup.mesh("the cage is made around the mesh",
                                   "make one with `deform cage mesh` and name it with `file`");
            },
            setup, method);
      } catch (const Error& error) {
        throw Error(error.code(), from.name + ": " + error.what());
      }
    });
  };
  if (setup.has_method()) fill("", *setup.mutable_method());
  for (int i = 0; i < setup.then_size(); ++i) {
    if (setup.then(i).has_method()) fill("then[" + std::to_string(i) + "].", *setup.mutable_then(i)->mutable_method());
  }
  return setup;
}

SetupText text_of(const std::filesystem::path& path, const io::ReadOptions& reading) {
  constexpr std::size_t max_bytes = std::size_t{1} << 26;
  return {io::read_file(path, nullptr, max_bytes), path.string(), path.parent_path(), GeometryEntry::needed, reading};
}

void take_geometry(const std::string& name, const std::filesystem::path& folder, SetupFile& file, Problems& problems) {
  const std::string geometry = file.setup.geometry();
  const bool given = problems.check("geometry", [&] {
    if (!geometry.empty()) return;
    throw Error(ErrorCode::invalid_argument, name + ": geometry: missing, expected a mesh file or a geometry id");
  });
  if (!given) return;
  const std::filesystem::path mesh = folder / geometry;
  if (io::mesh_exists(mesh)) {
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

SetupFile parse_setup(const SetupText& from, Problems& problems) {
  SetupFile file;
  file.setup = parsed_text(from, file.files, problems);
  if (from.geometry == GeometryEntry::needed) {
    take_geometry(from.name, from.folder, file, problems);
  } else {
    file.setup.clear_geometry();
  }
  return file;
}

SetupFile read_setup_file(const std::filesystem::path& path, const io::ReadOptions& reading) {
  Problems problems(Problems::Mode::throw_first);
  return read_setup_file(path, problems, reading);
}

SetupFile read_setup_file(const std::filesystem::path& path, Problems& problems, const io::ReadOptions& reading) {
  return parse_setup(text_of(path, reading), problems);
}

v1::Method read_method_file(const std::filesystem::path& path, std::shared_ptr<const Mesh> mesh) {
  Problems problems(Problems::Mode::throw_first);
  std::vector<std::filesystem::path> read;
  SetupText text = text_of(path, {});
  text.mesh = std::move(mesh);
  const v1::Setup setup = parsed_text(text, read, problems);
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

}  // namespace deform::client
