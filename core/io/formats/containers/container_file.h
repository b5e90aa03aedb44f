// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>

namespace deform::io {

/// libcgns, libnetcdf and the HDF5 library below both keep global state without locks: whoever calls one of them holds this lock.
std::unique_lock<std::mutex> lock_containers();

/// What a file may grow to when its coordinates are overwritten: HDF5 may place compressed data anew.
constexpr std::size_t largest_rewritten(std::size_t bytes) { return 2 * bytes + (std::size_t{1} << 20); }

/// Bytes as a file that those libraries can open by its name: a new file in the temporary folder (TMPDIR, else /tmp) which only
/// its owner may read. It vanishes from the folder with unlink(), once a library has it open, at the latest with this object.
class ContainerFile {
 public:
  explicit ContainerFile(std::string_view bytes);
  /// The file of another process, which looks after it; unlink() takes its name away all the same.
  static ContainerFile of_other_process(const std::string& path) { return ContainerFile(path, Existing{}); }
  ~ContainerFile();
  ContainerFile(const ContainerFile&) = delete;
  ContainerFile& operator=(const ContainerFile&) = delete;

  const std::string& path() const { return path_; }
  void unlink();
  /// What it holds now; throws Error(invalid_argument) when that is more than `most` bytes.
  std::string bytes(std::size_t most) const;

 private:
  struct Existing {};
  ContainerFile(std::string path, Existing) : path_(std::move(path)), named_(true) {}

  std::string path_;
  int descriptor_ = -1;
  bool named_ = false;
};

}  // namespace deform::io
