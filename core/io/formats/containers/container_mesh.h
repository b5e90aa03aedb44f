// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "core/io/formats/containers/container_file.h"
#include "core/io/readers.h"

namespace deform::io {

/// The content of a file that only a library can parse: CGNS and Exodus.
struct ContainerMesh {
  std::shared_ptr<const Mesh> mesh;
  std::string layout;  ///< positions of its coordinates, opaque except for overwrite() of the same library
  bool flat = false;   ///< the file cannot store z
};

/// The functions of a library that parses a format. They may crash on damaged files and are not thread-safe. `bytes` is the size
/// of the file, `name` is used in errors, which are Error(invalid_argument).
struct ContainerLibrary {
  const char* name = "";  ///< in messages: "the CGNS library"
  ContainerMesh (*read)(ContainerFile& file, std::size_t bytes, const std::string& name) = nullptr;
  /// Replaces the coordinates; the number of points must be unchanged.
  void (*overwrite)(ContainerFile& file, std::size_t bytes, const std::string& name, const std::string& layout,
                    std::span<const Vec3> points) = nullptr;
  /// Whether the library is safe for these bytes, all of which have been checked; throws if they are damaged.
  bool (*is_harmless)(std::string_view bytes, const std::string& name) = nullptr;
  /// Undoes changes by the library other than those of coordinates.
  void (*restore)(const std::string& original, std::string& written) = nullptr;
};

/// Creates the mesh file of a format with a library, which runs in this process or in a separate one.
std::unique_ptr<MeshFile> parse_container(const Reader& reader, std::string bytes, const std::string& name,
                                          const ReadOptions& options);

}  // namespace deform::io
