// SPDX-License-Identifier: Apache-2.0
#include "core/io/coloured_ply.h"

#include "core/base/error.h"
#include "core/io/binary/byte_order.h"
#include "core/io/mesh_file.h"

namespace deform::io {

namespace {

constexpr std::uint32_t most_corners = 255;

template <typename T>
void append(T value, std::string& to) {
  char bytes[sizeof(T)];
  store_scalar(bytes, value, std::endian::little);
  to.append(bytes, sizeof(T));
}

enum class Coloured { faces, points };

std::string bytes_of(const Mesh& mesh, Coloured coloured, std::span<const Colour> colours) {
  const bool by_point = coloured == Coloured::points;
  const std::size_t expected = by_point ? mesh.point_count() : mesh.face_count();
  if (colours.size() != expected) {
    throw Error(ErrorCode::invalid_argument, "colours: " + std::to_string(colours.size()) + " for " + std::to_string(expected) +
                                                 (by_point ? " points" : " faces"));
  }
  const std::string channels = "property uchar red\nproperty uchar green\nproperty uchar blue\n";
  std::string bytes = "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(mesh.point_count()) +
                      "\nproperty double x\nproperty double y\nproperty double z\n" + (by_point ? channels : "") +
                      "element face " + std::to_string(mesh.face_count()) + "\nproperty list uchar uint vertex_indices\n" +
                      (by_point ? "" : channels) + "end_header\n";
  const auto add_colour = [&](std::size_t i) {
    for (const unsigned char channel : colours[i]) append(channel, bytes);
  };
  bytes.reserve(bytes.size() + 27 * mesh.point_count() + 4 * mesh.face_points.size() + 4 * mesh.face_count());
  for (std::size_t i = 0; i < mesh.point_count(); ++i) {
    for (const double value : mesh.points[i]) append(std::bit_cast<std::uint64_t>(value), bytes);
    if (by_point) add_colour(i);
  }
  const PointId* corner = mesh.face_points.data();
  for (std::size_t f = 0; f < mesh.face_count(); ++f) {
    const std::uint32_t size = mesh.face_sizes[f];
    if (size > most_corners) {
      throw Error(ErrorCode::invalid_argument,
                  "face " + std::to_string(f) + ": " + std::to_string(size) + " corners are more than the 255 of a PLY file");
    }
    append(static_cast<std::uint8_t>(size), bytes);
    for (std::uint32_t k = 0; k < size; ++k) append(*corner++, bytes);
    if (!by_point) add_colour(f);
  }
  return bytes;
}

}  // namespace

std::string coloured_ply_bytes(const Mesh& mesh, std::span<const Colour> colours) {
  return bytes_of(mesh, Coloured::faces, colours);
}

std::string point_coloured_ply_bytes(const Mesh& mesh, std::span<const Colour> colours) {
  return bytes_of(mesh, Coloured::points, colours);
}

void write_coloured_ply(const Mesh& mesh, std::span<const Colour> colours, const std::filesystem::path& path) {
  write_file(path, coloured_ply_bytes(mesh, colours));
}

void write_point_coloured_ply(const Mesh& mesh, std::span<const Colour> colours, const std::filesystem::path& path) {
  write_file(path, point_coloured_ply_bytes(mesh, colours));
}

}  // namespace deform::io
