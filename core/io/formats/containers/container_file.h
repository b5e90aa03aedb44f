// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>

namespace deform::io {

/// Locks libcgns, libnetcdf and the HDF5 library below both, which have global state without locks. Hold the lock during any call
/// of them.
std::unique_lock<std::mutex> lock_containers();

/// The largest size of a file after overwriting its coordinates: HDF5 may relocate compressed data.
constexpr std::size_t largest_rewritten(std::size_t bytes) { return 2 * bytes + (std::size_t{1} << 20); }

/// A temporary file (in TMPDIR, else /tmp) that those libraries can open by name and only its owner can read. It is removed from
/// the folder by unlink(), once a library has opened it, or by the destructor.
class ContainerFile {
 public:
  /// Throws Error(failed_precondition) if there is no such folder or the file cannot be written.
  explicit ContainerFile(std::string_view bytes);
  /// A file owned by another process. unlink() removes its name nevertheless.
  static ContainerFile of_other_process(const std::string& path) { return ContainerFile(path, Existing{}); }
  ~ContainerFile();
  ContainerFile(const ContainerFile&) = delete;
  ContainerFile& operator=(const ContainerFile&) = delete;

  const std::string& path() const { return path_; }
  void unlink();
  /// The current content; throws Error(invalid_argument) if it has more than `most` bytes.
  std::string bytes(std::size_t most) const;

 private:
  struct Existing {};
  ContainerFile(std::string path, Existing) : path_(std::move(path)), named_(true) {}

  std::string path_;
  int descriptor_ = -1;
  bool named_ = false;
};

}  // namespace deform::io
