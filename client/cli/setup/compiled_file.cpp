// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/setup/compiled_file.h"

#include <array>
#include <fstream>
#include <vector>

#include "core/base/error.h"
#include "core/base/text.h"
#include "core/codec/geometry_id.h"
#include "core/compiled/layout.h"

namespace deform::cli {

bool is_compiled_file(const std::filesystem::path& file) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error)) return false;
  std::array<char, compiled::magic.size()> begin{};
  std::ifstream stream(file, std::ios::binary);
  return stream.read(begin.data(), begin.size()) && begin == compiled::magic;
}

v1::Setup compiled_setup(const compiled::Content& content, const std::filesystem::path& file) {
  v1::Setup setup;
  const bool parsed = setup.ParseFromString(content.setup);
  if (!parsed || static_cast<std::size_t>(setup.variables_size()) != content.variables.size()) {
    throw Error(ErrorCode::data_loss, file.string() + ": holds no setup that can be read");
  }
  return setup;
}

std::filesystem::path compiled_mesh_path(const compiled::Content& content, const std::filesystem::path& file,
                                         const std::string& source) {
  if (!source.empty()) return source;
  // A name, whatever it says: it does not lead out of these folders.
  const std::filesystem::path name = std::filesystem::path(content.mesh).filename();
  if (!name.empty()) {
    for (const std::filesystem::path& path : {file.parent_path() / name, name}) {
      std::error_code error;
      if (std::filesystem::exists(path, error)) return path;
    }
  }
  throw Error(ErrorCode::invalid_argument,
              file.string() + ": its mesh" + (name.empty() ? "" : " " + printable(name.string())) +
                  " is not beside it: give the mesh file that results are written into, --source FILE");
}

void check_compiled_mesh(const compiled::Content& content, const Mesh& mesh, const std::filesystem::path& path) {
  std::vector<codec::GroupView> groups;
  for (const auto& group : mesh.groups) groups.push_back({group.name, group.points, group.faces});
  const std::string id = codec::geometry_id({mesh.points, mesh.face_sizes, mesh.face_points, groups, mesh.cells_view()});
  if (id == content.geometry_id) return;
  throw Error(ErrorCode::invalid_argument,
              path.string() + ": holds geometry " + id + ", the deformation was compiled for " + content.geometry_id);
}

}  // namespace deform::cli
