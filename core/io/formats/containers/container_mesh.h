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

/// What is read of a file that only a library can parse: CGNS and Exodus.
struct ContainerMesh {
  std::shared_ptr<const Mesh> mesh;
  std::string layout;  ///< where its coordinates stand; only overwrite() of the same library understands it
  bool flat = false;   ///< the file has no place for z
};

/// The library that parses a format, by what it is called for. All of these may crash on damaged files and take one caller at a
/// time. `bytes` is the size of the file, `name` stands in errors, which are Error(invalid_argument).
struct ContainerLibrary {
  const char* name = "";  ///< in messages: "the CGNS library"
  ContainerMesh (*read)(ContainerFile& file, std::size_t bytes, const std::string& name) = nullptr;
  /// Other coordinates of as many points as were read.
  void (*overwrite)(ContainerFile& file, std::size_t bytes, const std::string& name, const std::string& layout,
                    std::span<const Vec3> points) = nullptr;
  /// Whether the library can do no harm with these bytes, all of which were checked; throws when they are damaged.
  bool (*is_harmless)(std::string_view bytes, const std::string& name) = nullptr;
  /// Takes back what the library wrote beside coordinates.
  void (*restore)(const std::string& original, std::string& written) = nullptr;
};

/// The mesh file of a reader with a library, in this process or in one of its own.
std::unique_ptr<MeshFile> parse_container(const Reader& reader, std::string bytes, const std::string& name,
                                          const ReadOptions& options);

}  // namespace deform::io
