// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/geometry_file.h"

#include <fcntl.h>

#include <cstring>
#include <vector>

#include "core/base/error.h"
#include "core/codec/geometry_id.h"
#include "core/mesh/cells.h"
#include "core/mesh/elements.h"
#include "server/store/file.h"

namespace deform::server {

namespace {

constexpr char tag[] = "deform.geometry.1";
constexpr char tag_with_cells[] = "deform.geometry.2";

codec::GeometryView view(const Mesh& mesh, std::vector<codec::GroupView>& groups) {
  for (const auto& group : mesh.groups) groups.push_back({group.name, group.points, group.faces});
  return {mesh.points, mesh.face_sizes, mesh.face_points, groups, mesh.cells_view()};
}

/// Reads arrays and hashes what it reads; nothing is allocated that the file is too short for.
class Reader {
 public:
  Reader(FileSystem& files, const std::filesystem::path& path, const std::string& id)
      : id_(id), file_(files, path, O_RDONLY), left_(file_size(files, path)) {}

  void take(void* data, std::size_t size) {
    if (size > left_ || file_.read(data, size) != size) damaged();
    left_ -= size;
    hash_.add(data, size);
  }
  std::size_t take_count(std::size_t bytes_per_item) {
    std::uint64_t count = 0;
    take(&count, sizeof(count));
    if (count > left_ / bytes_per_item) damaged();
    return count;
  }
  template <typename Array>
  void take_array(Array& array) {
    using Item = typename Array::value_type;
    array.resize(take_count(sizeof(Item)));
    take(array.data(), array.size() * sizeof(Item));
  }
  void finish() {
    if (left_ != 0 || hash_.hex() != id_) damaged();
  }
  [[noreturn]] void damaged() const {
    throw Error(ErrorCode::data_loss, "geometry " + id_ + ": the stored file is damaged; register the geometry again");
  }

 private:
  std::string id_;
  File file_;
  std::size_t left_;
  codec::Sha256 hash_;
};

void read_cells(Reader& reader, Mesh& mesh) {
  Elements elements;
  reader.take_array(elements.types);
  reader.take_array(elements.points);
  PolyhedralCells cells;
  cells.cell_count = reader.take_count(1);
  reader.take_array(cells.face_offsets);
  reader.take_array(cells.face_points);
  reader.take_array(cells.owner);
  reader.take_array(cells.neighbour);
  reader.take_array(cells.empty_faces);
  if (cells.cell_count > 0) {
    mesh.cells = std::make_shared<const PolyhedralCells>(std::move(cells));
    return;
  }
  elements.offsets.reserve(elements.types.size() + 1);
  for (const ElementType type : elements.types) {
    if (static_cast<std::size_t>(type) >= element_types) reader.damaged();
    elements.offsets.push_back(elements.offsets.back() + shape(type).nodes);
  }
  mesh.elements = std::make_shared<const Elements>(std::move(elements));
}

}  // namespace

std::size_t mesh_bytes(const Mesh& mesh) {
  std::size_t bytes = sizeof(Mesh) + mesh.points.size() * sizeof(Vec3) + mesh.face_sizes.size() * 4 + mesh.face_points.size() * 4;
  for (const auto& group : mesh.groups) {
    bytes += sizeof(Group) + group.name.size() + 4 * (group.points.size() + group.faces.size());
  }
  if (mesh.elements) bytes += mesh.elements->bytes();
  if (mesh.cells) bytes += mesh.cells->bytes();
  return bytes;
}

std::string mesh_id(const Mesh& mesh) {
  std::vector<codec::GroupView> groups;
  return codec::geometry_id(view(mesh, groups));
}

void write_geometry_file(const Mesh& mesh, const std::filesystem::path& path, FileSystem& files) {
  try {
    const File file(files, path, O_WRONLY | O_CREAT | O_EXCL);
    std::vector<codec::GroupView> groups;
    std::vector<char> buffer;  // joins the small pieces
    constexpr std::size_t buffer_size = 1u << 20;
    const auto flush = [&] {
      file.write(buffer.data(), buffer.size());
      buffer.clear();
    };
    codec::visit_geometry_bytes(view(mesh, groups), [&](const void* data, std::size_t size) {
      if (buffer.size() + size > buffer_size) flush();
      if (size > buffer_size) {
        file.write(data, size);
      } else {
        const auto* bytes = static_cast<const char*>(data);
        buffer.insert(buffer.end(), bytes, bytes + size);
      }
    });
    flush();
    file.sync();
  } catch (...) {
    try_remove(files, path);
    throw;
  }
}

Mesh read_geometry_file(const std::filesystem::path& path, const std::string& id, FileSystem& files) {
  Reader reader(files, path, id);
  char found[sizeof(tag)];
  reader.take(found, sizeof(found));
  const bool with_cells = std::memcmp(found, tag_with_cells, sizeof(tag)) == 0;
  if (!with_cells && std::memcmp(found, tag, sizeof(tag)) != 0) reader.damaged();
  Mesh mesh;
  reader.take_array(mesh.points);
  reader.take_array(mesh.face_sizes);
  reader.take_array(mesh.face_points);
  const std::size_t groups = reader.take_count(3 * sizeof(std::uint64_t));
  for (std::size_t g = 0; g < groups; ++g) {
    Group& group = mesh.groups.emplace_back();
    reader.take_array(group.name);
    reader.take_array(group.points);
    reader.take_array(group.faces);
  }
  if (with_cells) read_cells(reader, mesh);
  reader.finish();
  return mesh;
}

}  // namespace deform::server
