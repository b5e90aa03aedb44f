// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/geometry_file.h"

#include <fcntl.h>

#include <algorithm>
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

/// Passes the content of a mesh on in pieces.
void visit_pieces(const Mesh& mesh, const char* stage, const RunContext& context, const codec::ByteSink& sink) {
  std::vector<codec::GroupView> groups;
  const auto total = static_cast<double>(mesh_bytes(mesh));
  std::size_t done = 0, checked = 0;
  codec::visit_geometry_bytes(view(mesh, groups), [&](const void* data, std::size_t size) {
    const auto* bytes = static_cast<const char*>(data);
    for (std::size_t first = 0; first < size; first += content_piece) {
      const std::size_t piece = std::min(content_piece, size - first);
      sink(bytes + first, piece);
      done += piece;
      if (done - checked < content_piece) continue;
      checked = done;
      context.progress(stage, std::min(1.0, static_cast<double>(done) / total));
      context.check();
    }
  });
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

std::string mesh_id(const Mesh& mesh, const RunContext& context) {
  codec::Sha256 hash;
  context.check();
  visit_pieces(mesh, "hash", context, [&](const void* data, std::size_t size) { hash.add(data, size); });
  return hash.hex();
}

void write_geometry_file(const Mesh& mesh, const std::filesystem::path& path, FileSystem& files, const RunContext& context) {
  try {
    context.check();
    const File file(files, path, O_WRONLY | O_CREAT | O_EXCL);
    std::vector<char> buffer;  // joins the small pieces
    const auto flush = [&] {
      file.write(buffer.data(), buffer.size());
      buffer.clear();
    };
    visit_pieces(mesh, "write", context, [&](const void* data, std::size_t size) {
      if (buffer.size() + size > content_piece) flush();
      if (size == content_piece) return file.write(data, size);
      const auto* bytes = static_cast<const char*>(data);
      buffer.insert(buffer.end(), bytes, bytes + size);
    });
    flush();
    context.check();
    file.sync();
    context.check();  // nobody sees it yet
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
