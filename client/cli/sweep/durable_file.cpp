// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/sweep/durable_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include "core/base/error.h"

namespace deform::cli {

DurableFile::DurableFile(std::filesystem::path path) : path_(std::move(path)) {
  descriptor_ = ::open(path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
  struct stat status {};
  if (descriptor_ < 0 || ::fstat(descriptor_, &status) != 0) {
    const int error = errno;
    if (descriptor_ >= 0) ::close(descriptor_);
    errno = error;
    fail("cannot write ");
  }
  size_ = static_cast<std::uint64_t>(status.st_size);
}

DurableFile::~DurableFile() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

DurableFile::DurableFile(DurableFile&& other) noexcept
    : path_(std::move(other.path_)), descriptor_(std::exchange(other.descriptor_, -1)), size_(other.size_) {}

DurableFile& DurableFile::operator=(DurableFile&& other) noexcept {
  std::swap(path_, other.path_);
  std::swap(descriptor_, other.descriptor_);
  std::swap(size_, other.size_);
  return *this;
}

void DurableFile::fail(const char* what) const {
  throw Error(ErrorCode::failed_precondition, what + path_.string() + ": " + std::strerror(errno));
}

void DurableFile::append(std::string_view bytes) {
  std::uint64_t at = size_;
  while (!bytes.empty()) {
    const ssize_t written = ::pwrite(descriptor_, bytes.data(), bytes.size(), static_cast<off_t>(at));
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) {
      const int error = errno;
      if (::ftruncate(descriptor_, static_cast<off_t>(size_)) != 0) {
        // Torn then, as after a crash: the next run cuts it off.
      }
      errno = error;
      fail("cannot write ");
    }
    bytes.remove_prefix(static_cast<std::size_t>(written));
    at += static_cast<std::uint64_t>(written);
  }
  size_ = at;
}

void DurableFile::cut(std::uint64_t size) {
  if (::ftruncate(descriptor_, static_cast<off_t>(size)) != 0) fail("cannot write ");
  size_ = size;
}

void DurableFile::sync() {
  if (::fdatasync(descriptor_) != 0) fail("cannot write ");
}

std::string DurableFile::read(std::uint64_t offset, std::size_t bytes) const {
  std::string content(bytes, '\0');
  std::size_t used = 0;
  while (used < bytes) {
    const ssize_t got = ::pread(descriptor_, content.data() + used, bytes - used, static_cast<off_t>(offset + used));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) fail("cannot read ");
    if (got == 0) break;
    used += static_cast<std::size_t>(got);
  }
  content.resize(used);
  return content;
}

bool DurableFile::lock() { return ::flock(descriptor_, LOCK_EX | LOCK_NB) == 0; }

bool DurableFile::is_current() const {
  struct stat mine {
  }, named{};
  return ::fstat(descriptor_, &mine) == 0 && ::stat(path_.c_str(), &named) == 0 && mine.st_dev == named.st_dev &&
         mine.st_ino == named.st_ino;
}

void DurableFile::rename(const std::filesystem::path& target) {
  if (::rename(path_.c_str(), target.c_str()) != 0) fail("cannot rename ");
  path_ = target;
  sync_folder(target.parent_path());
}

void sync_folder(const std::filesystem::path& folder) {
  const std::filesystem::path named = folder.empty() ? std::filesystem::path(".") : folder;
  const int descriptor = ::open(named.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  // Some network file systems cannot sync folders; they have nothing to sync either.
  if (descriptor < 0) return;
  const bool failed = ::fsync(descriptor) != 0 && errno != EINVAL && errno != ENOTSUP;
  const int error = errno;
  ::close(descriptor);
  if (failed) throw Error(ErrorCode::failed_precondition, "cannot write " + named.string() + ": " + std::strerror(error));
}

}  // namespace deform::cli
