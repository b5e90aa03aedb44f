// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/containers/container_mesh.h"

#include "core/io/assembly/coordinate_records.h"
#include "core/io/formats/containers/isolated_library.h"

namespace deform::io {

namespace {

class ContainerMeshFile : public MeshFile {
 public:
  ContainerMeshFile(const Reader& reader, std::string bytes, ContainerMesh content, std::string name,
                    std::optional<IsolatedLibrary> isolated)
      : MeshFile(reader.format, std::move(content.mesh)),
        library_(*reader.library),
        bytes_(std::move(bytes)),
        layout_(std::move(content.layout)),
        flat_(content.flat),
        name_(std::move(name)),
        isolated_(std::move(isolated)) {}

  std::string with_points(std::span<const Vec3> points) const override {
    const Points& before = original_points();
    check_points(points, before.size());
    if (flat_) check_plane(points, before);
    if (same_points(points, before)) return bytes_;
    ContainerFile file(bytes_);
    if (isolated_) {
      isolated_->overwrite(file, bytes_.size(), name_, layout_, points);
    } else {
      library_.overwrite(file, bytes_.size(), name_, layout_, points);
    }
    std::string written = file.bytes(largest_rewritten(bytes_.size()));
    if (library_.restore) library_.restore(bytes_, written);
    return written;
  }

  bool two_dimensional() const override { return flat_; }

 private:
  const ContainerLibrary& library_;
  const std::string bytes_, layout_;
  const bool flat_;
  const std::string name_;
  const std::optional<IsolatedLibrary> isolated_;
};

}  // namespace

std::unique_ptr<MeshFile> parse_container(const Reader& reader, std::string bytes, const std::string& name,
                                          const ReadOptions& options) {
  const bool harmless = reader.library->is_harmless && reader.library->is_harmless(bytes, name);
  std::optional<IsolatedLibrary> isolated;
  if (!options.isolated_reader.empty() && !harmless) isolated.emplace(reader.format, options);
  ContainerMesh content;
  {
    ContainerFile file(bytes);
    content = isolated ? isolated->read(file, bytes.size(), name) : reader.library->read(file, bytes.size(), name);
  }
  return std::make_unique<ContainerMeshFile>(reader, std::move(bytes), std::move(content), name, std::move(isolated));
}

}  // namespace deform::io
