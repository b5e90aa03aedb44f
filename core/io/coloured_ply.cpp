#include "core/io/coloured_ply.h"

#include "core/base/error.h"
#include "core/io/byte_order.h"
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

}  // namespace

std::string coloured_ply_bytes(const Mesh& mesh, std::span<const Colour> colours) {
  if (colours.size() != mesh.face_count()) {
    throw Error(ErrorCode::invalid_argument,
                "colours: " + std::to_string(colours.size()) + " for " + std::to_string(mesh.face_count()) + " faces");
  }
  std::string bytes = "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(mesh.point_count()) +
                      "\nproperty double x\nproperty double y\nproperty double z\nelement face " +
                      std::to_string(mesh.face_count()) +
                      "\nproperty list uchar uint vertex_indices\nproperty uchar red\nproperty uchar green\nproperty uchar "
                      "blue\nend_header\n";
  bytes.reserve(bytes.size() + 24 * mesh.point_count() + 4 * mesh.face_points.size() + 4 * mesh.face_count());
  for (const Vec3& x : mesh.points) {
    for (const double value : x) append(std::bit_cast<std::uint64_t>(value), bytes);
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
    for (const unsigned char channel : colours[f]) append(channel, bytes);
  }
  return bytes;
}

void write_coloured_ply(const Mesh& mesh, std::span<const Colour> colours, const std::filesystem::path& path) {
  write_file(path, coloured_ply_bytes(mesh, colours));
}

}  // namespace deform::io
