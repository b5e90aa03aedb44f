// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <string_view>

#include "core/base/error.h"
#include "core/io/gzip.h"
#include "core/io/mesh_file.h"

namespace deform::fuzz {

inline void require(bool condition, const char* what) {
  if (condition) return;
  std::fprintf(stderr, "violated: %s\n", what);
  std::abort();
}

/// Which order of faces a reader must give when only points moved: `any` when it judges by the coordinates how a program means
/// the order of nodes (wedges of VTK).
enum class FaceOrder { same, any };

/// The corners of every face in ascending order, faces likewise.
inline std::vector<std::vector<PointId>> sorted_faces(const Mesh& mesh) {
  std::vector<std::vector<PointId>> faces;
  std::size_t corner = 0;
  for (const std::uint32_t size : mesh.face_sizes) {
    const auto first = mesh.face_points.begin() + static_cast<std::ptrdiff_t>(corner);
    faces.emplace_back(first, first + size);
    std::sort(faces.back().begin(), faces.back().end());
    corner += size;
  }
  std::sort(faces.begin(), faces.end());
  return faces;
}

/// Whatever the bytes are, a reader either throws Error(invalid_argument), or gives a valid mesh whose file is written back byte
/// for byte, and with other coordinates to a file that reads as the same mesh with those coordinates.
template <typename Parse>
void check_reader(const std::string& bytes, const Parse& parse, FaceOrder order = FaceOrder::same) {
  std::unique_ptr<io::MeshFile> file;
  try {
    file = parse(bytes);
  } catch (const Error& error) {
    require(error.code() == ErrorCode::invalid_argument, "a refused file is an invalid argument");
    return;
  }
  const auto mesh = file->mesh();
  mesh->validate();
  require(file->with_points(mesh->points) == bytes, "undeformed coordinates give the same bytes");

  // A 2D file has no place for another z.
  const bool flat = std::all_of(mesh->points.begin(), mesh->points.end(), [](const Vec3& p) { return p[2] == 0; });
  Points moved(mesh->point_count());
  for (std::size_t i = 0; i < moved.size(); ++i) {
    moved[i] = {1 + 0.5 * static_cast<double>(i), -0.25 * static_cast<double>(i),
                flat ? 0.0 : 3.0};  // floats hold these, all points differ
  }
  const auto again = parse(file->with_points(moved));
  require(again->mesh()->points == moved, "written coordinates read back");
  if (order == FaceOrder::any) {
    require(sorted_faces(*again->mesh()) == sorted_faces(*mesh), "faces keep their corners when points move");
    return;
  }
  require(again->mesh()->face_sizes == mesh->face_sizes && again->mesh()->face_points == mesh->face_points,
          "faces do not change when points move");
}

inline void read_and_write_back(std::string_view bytes, const std::string& name, FaceOrder order = FaceOrder::same,
                                const io::ReadOptions& options = {}) {
  if (io::is_gzip(bytes)) return;  // zlib has its own fuzzers, and the bytes behind it come without packing as well
  check_reader(
      std::string(bytes), [&](const std::string& file) { return io::parse_mesh(file, name, options); }, order);
}

}  // namespace deform::fuzz
