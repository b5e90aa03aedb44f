#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>

#include "core/io/formats/containers/container_file.h"
#include "core/io/mesh_file.h"

namespace deform::io {

/// What is read of a file that only a library can parse: CGNS and Exodus.
struct ContainerMesh {
  std::shared_ptr<const Mesh> mesh;
  std::string layout;  ///< where its coordinates stand; only overwrite_*() of the same format understands it
  bool flat = false;   ///< the file has no place for z
};

// All of these call libraries that may crash on damaged files and that take one caller at a time. `bytes` is the size of the
// file, `name` stands in errors, which are Error(invalid_argument).

ContainerMesh read_cgns(ContainerFile& file, std::size_t bytes, const std::string& name);
ContainerMesh read_exodus(ContainerFile& file, std::size_t bytes, const std::string& name);

/// Other coordinates of as many points as were read.
void overwrite_cgns(ContainerFile& file, std::size_t bytes, const std::string& name, const std::string& layout,
                    std::span<const Vec3> points);
void overwrite_exodus(ContainerFile& file, std::size_t bytes, const std::string& name, const std::string& layout,
                      std::span<const Vec3> points);

/// The one of the format.
ContainerMesh read_container(Format format, ContainerFile& file, std::size_t bytes, const std::string& name);
void overwrite_container(Format format, ContainerFile& file, std::size_t bytes, const std::string& name,
                         const std::string& layout, std::span<const Vec3> points);

}  // namespace deform::io
