// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/containers/container_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <system_error>

#include "core/base/error.h"

namespace deform::io {

namespace {

[[noreturn]] void fail(const std::string& path) {
  throw Error(ErrorCode::failed_precondition, "temporary file " + path + ": " + std::strerror(errno));
}

std::string path_pattern() {
  std::error_code error;
  const std::filesystem::path folder = std::filesystem::temp_directory_path(error);
  if (error) throw Error(ErrorCode::failed_precondition, "temporary files: TMPDIR names no folder: " + error.message());
  return (folder / "deform-XXXXXX").string();
}

}  // namespace

std::unique_lock<std::mutex> lock_containers() {
  static std::mutex mutex;
  return std::unique_lock(mutex);
}

ContainerFile::ContainerFile(std::string_view bytes) : path_(path_pattern()) {
  descriptor_ = ::mkostemp(path_.data(), O_CLOEXEC);
  if (descriptor_ < 0) fail(path_);
  named_ = true;
  while (!bytes.empty()) {
    const ssize_t written = ::write(descriptor_, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) {
      const int error = errno;
      unlink();
      ::close(descriptor_);
      errno = error;
      fail(path_);
    }
    bytes.remove_prefix(static_cast<std::size_t>(written));
  }
}

ContainerFile::~ContainerFile() {
  unlink();
  if (descriptor_ >= 0) ::close(descriptor_);
}

void ContainerFile::unlink() {
  if (named_) ::unlink(path_.c_str());
  named_ = false;
}

std::string ContainerFile::bytes(std::size_t most) const {
  struct stat status {};
  if (::fstat(descriptor_, &status) != 0) fail(path_);
  if (static_cast<std::uint64_t>(status.st_size) > most) {
    throw Error(ErrorCode::invalid_argument, "the mesh file grew to " + std::to_string(status.st_size) +
                                                 " bytes while its coordinates were written; it is damaged");
  }
  std::string bytes(static_cast<std::size_t>(status.st_size), '\0');
  std::size_t used = 0;
  while (used < bytes.size()) {
    const ssize_t got = ::pread(descriptor_, bytes.data() + used, bytes.size() - used, static_cast<off_t>(used));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) fail(path_);
    used += static_cast<std::size_t>(got);
  }
  return bytes;
}

}  // namespace deform::io
