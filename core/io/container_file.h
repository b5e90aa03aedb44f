#pragma once

#include <mutex>
#include <string>
#include <string_view>

namespace deform::io {

/// libcgns, libnetcdf and the HDF5 library below both keep global state without locks: whoever calls one of them holds this lock.
std::unique_lock<std::mutex> lock_containers();

/// Bytes as a file that those libraries can open by its name: a new file in the temporary folder (TMPDIR, else /tmp) which only
/// its owner may read. It vanishes from the folder with unlink(), once a library has it open, at the latest with this object.
class ContainerFile {
 public:
  explicit ContainerFile(std::string_view bytes);
  ~ContainerFile();
  ContainerFile(const ContainerFile&) = delete;
  ContainerFile& operator=(const ContainerFile&) = delete;

  const std::string& path() const { return path_; }
  void unlink();
  /// What it holds now.
  std::string bytes() const;

 private:
  std::string path_;
  int descriptor_ = -1;
  bool named_ = false;
};

}  // namespace deform::io
