// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/file.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <string>

#include "core/base/error.h"

namespace deform::server {

void fail_on(const char* action, const std::filesystem::path& path) {
  const bool full = errno == ENOSPC || errno == EDQUOT;
  throw Error(full ? ErrorCode::out_of_budget : ErrorCode::unavailable,
              std::string("store: cannot ") + action + " " + path.string() + ": " + std::strerror(errno));
}

File::File(const std::filesystem::path& path, int flags)
    : path_(path), descriptor_(::open(path.c_str(), flags | O_CLOEXEC, 0640)) {
  if (descriptor_ < 0) fail_on("open", path);
}

File::~File() { ::close(descriptor_); }

void File::write(const void* data, std::size_t size) const {
  const auto* from = static_cast<const char*>(data);
  while (size > 0) {
    const ssize_t written = ::write(descriptor_, from, std::min<std::size_t>(size, 1u << 30));
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) fail_on("write", path_);
    from += written;
    size -= static_cast<std::size_t>(written);
  }
}

std::size_t File::read(void* data, std::size_t size) const {
  auto* to = static_cast<char*>(data);
  std::size_t total = 0;
  while (total < size) {
    const ssize_t got = ::read(descriptor_, to + total, std::min<std::size_t>(size - total, 1u << 30));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) fail_on("read", path_);
    if (got == 0) break;
    total += static_cast<std::size_t>(got);
  }
  return total;
}

void File::sync() const {
  if (::fsync(descriptor_) != 0) fail_on("sync", path_);
}

void sync_directory(const std::filesystem::path& directory) { File(directory, O_RDONLY | O_DIRECTORY).sync(); }

void sync_file_system(const std::filesystem::path& directory) {
  const int descriptor = ::open(directory.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  const int result = descriptor < 0 ? -1 : ::syncfs(descriptor);
  if (descriptor >= 0) ::close(descriptor);
  if (result != 0) fail_on("sync", directory);
}

void move_file(const std::filesystem::path& from, const std::filesystem::path& to) {
  if (std::rename(from.c_str(), to.c_str()) != 0) fail_on("move", from);
}

}  // namespace deform::server
