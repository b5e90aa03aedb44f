// SPDX-License-Identifier: GPL-3.0-or-later
// What a child process sends that reads a file for its parent. The child runs a library that may have been taken over, so nothing
// that it sends may harm. Bytes are edits of what write_mesh() makes of a small mesh; without any, the mesh comes back as it was.
#include <cstring>

#include "core/io/assembly/mesh_stream.h"
#include "core/mesh/cells.h"
#include "core/mesh/elements.h"
#include "tests/fuzz/read_and_write_back.h"

namespace {

using namespace deform;

constexpr std::uint64_t most_bytes = 1u << 20;

Mesh tetrahedron() {
  Mesh mesh;
  mesh.points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  mesh.face_sizes = {3, 3, 3, 3};
  mesh.face_points = {0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2};
  mesh.groups = {{"bottom", {}, {0}}, {"tip", {3}, {}}};
  return mesh;
}

Mesh of_kind(unsigned kind) {
  Mesh mesh = tetrahedron();
  if (kind == 1) {
    Elements elements;
    elements.types = {ElementType{}};
    elements.offsets = {0, 4};
    elements.points = {0, 1, 2, 3};
    mesh.elements = std::make_shared<const Elements>(std::move(elements));
  } else if (kind == 2) {
    PolyhedralCells cells;
    cells.face_offsets = {0, 3, 6, 9, 12};
    cells.face_points = mesh.face_points;
    cells.owner = {0, 0, 0, 0};
    cells.cell_count = 1;
    mesh.cells = std::make_shared<const PolyhedralCells>(std::move(cells));
  }
  return mesh;
}

std::string stream_of(const Mesh& mesh) {
  std::string bytes;
  io::ByteWriter to([&](std::string_view part) { bytes += part; });
  io::write_mesh(mesh, to);
  to.flush();
  return bytes;
}

Mesh mesh_of(const std::string& bytes) {
  std::size_t at = 0;
  io::ByteReader from(
      [&](char* to, std::size_t size) {
        const std::size_t count = std::min(size, bytes.size() - at);
        std::memcpy(to, bytes.data() + at, count);
        at += count;
        return count;
      },
      most_bytes);
  return io::read_mesh(from);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const Mesh original = of_kind(data[0] % 3);
  std::string bytes = stream_of(original);
  std::size_t edits = 0;
  for (std::size_t i = 1; i + 2 < size; i += 3, ++edits) {
    bytes[(data[i] + 256u * data[i + 1]) % bytes.size()] = static_cast<char>(data[i + 2]);
  }
  if (data[0] & 64) bytes.resize(bytes.size() - bytes.size() * (data[0] >> 7) / 2 - 1);
  try {
    const Mesh mesh = mesh_of(bytes);
    mesh.validate();
    if (edits == 0) fuzz::require(stream_of(mesh) == stream_of(original), "a mesh comes back as it was sent");
  } catch (const Error& error) {
    fuzz::require(edits > 0 || (data[0] & 64), "a whole stream is a mesh");
    fuzz::require(error.code() == ErrorCode::data_loss || error.code() == ErrorCode::invalid_argument,
                  "a refused stream says why");
  }
  return 0;
}
