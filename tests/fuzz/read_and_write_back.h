#pragma once

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

/// Whatever the bytes are, a reader either throws Error(invalid_argument), or gives a valid mesh whose file is written back byte
/// for byte, and with other coordinates to a file that reads as the same mesh with those coordinates.
template <typename Parse>
void check_reader(const std::string& bytes, const Parse& parse) {
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

  Points moved(mesh->point_count());
  for (std::size_t i = 0; i < moved.size(); ++i) {
    moved[i] = {1 + 0.5 * static_cast<double>(i), -0.25 * static_cast<double>(i), 3};  // floats hold these, all points differ
  }
  const auto again = parse(file->with_points(moved));
  require(again->mesh()->points == moved, "written coordinates read back");
  require(again->mesh()->face_sizes == mesh->face_sizes && again->mesh()->face_points == mesh->face_points,
          "faces do not change when points move");
}

inline void read_and_write_back(std::string_view bytes, const std::string& name) {
  if (io::is_gzip(bytes)) return;  // zlib has its own fuzzers, and the bytes behind it come without packing as well
  check_reader(std::string(bytes), [&](const std::string& file) { return io::parse_mesh(file, name); });
}

}  // namespace deform::fuzz
