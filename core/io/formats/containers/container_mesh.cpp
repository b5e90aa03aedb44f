#include "core/io/formats/containers/container_mesh.h"

#include "core/io/assembly/coordinate_records.h"
#include "core/io/formats/containers/isolated_library.h"
#include "core/io/formats/exodus/netcdf_classic.h"
#include "core/io/readers.h"

namespace deform::io {

namespace {

/// ADF notes when a file was last changed behind the tag AdF1 of its first lines. Only coordinates are to differ.
void keep_date(const std::string& original, std::string& written) {
  constexpr std::size_t tag = 64, date = 68, length = 28;
  if (original.size() >= date + length && written.size() >= date + length && original.compare(tag, 4, "AdF1") == 0) {
    written.replace(date, length, original, date, length);
  }
}

class ContainerMeshFile : public MeshFile {
 public:
  ContainerMeshFile(Format format, std::string bytes, ContainerMesh content, std::string name,
                    std::optional<IsolatedLibrary> isolated)
      : format_(format),
        bytes_(std::move(bytes)),
        content_(std::move(content)),
        name_(std::move(name)),
        isolated_(std::move(isolated)) {}

  Format format() const override { return format_; }
  std::shared_ptr<const Mesh> mesh() const override { return content_.mesh; }

  std::string with_points(std::span<const Vec3> points) const override {
    const Points& before = content_.mesh->points;
    check_points(points, before.size());
    if (content_.flat) check_plane(points, before);
    if (same_points(points, before)) return bytes_;
    ContainerFile file(bytes_);
    if (isolated_) {
      isolated_->overwrite(file, bytes_.size(), name_, content_.layout, points);
    } else {
      overwrite_container(format_, file, bytes_.size(), name_, content_.layout, points);
    }
    std::string written = file.bytes(largest_rewritten(bytes_.size()));
    if (format_ == Format::cgns) keep_date(bytes_, written);
    // Of classic netCDF the library makes room for results that are not there yet.
    if (format_ == Format::exodus && is_classic_netcdf(bytes_)) written.resize(bytes_.size());
    return written;
  }

 private:
  const Format format_;
  const std::string bytes_;
  const ContainerMesh content_;
  const std::string name_;
  const std::optional<IsolatedLibrary> isolated_;
};

}  // namespace

ContainerMesh read_container(Format format, ContainerFile& file, std::size_t bytes, const std::string& name) {
  return format == Format::cgns ? read_cgns(file, bytes, name) : read_exodus(file, bytes, name);
}

void overwrite_container(Format format, ContainerFile& file, std::size_t bytes, const std::string& name,
                         const std::string& layout, std::span<const Vec3> points) {
  if (format == Format::cgns) return overwrite_cgns(file, bytes, name, layout, points);
  overwrite_exodus(file, bytes, name, layout, points);
}

std::unique_ptr<MeshFile> parse_container(Format format, std::string bytes, const std::string& name, const ReadOptions& options) {
  const bool classic = format == Format::exodus && is_classic_netcdf(bytes);
  if (classic) check_classic_netcdf(bytes, name);  // all of its header, before the library sees it
  std::optional<IsolatedLibrary> isolated;
  if (!options.isolated_reader.empty() && !classic) isolated.emplace(format, options);
  ContainerMesh content;
  {
    ContainerFile file(bytes);
    content = isolated ? isolated->read(file, bytes.size(), name) : read_container(format, file, bytes.size(), name);
  }
  return std::make_unique<ContainerMeshFile>(format, std::move(bytes), std::move(content), name, std::move(isolated));
}

}  // namespace deform::io
