// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/file_system.h"

#include <dirent.h>
#include <fcntl.h>
#include <sys/file.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>

namespace deform::server {

namespace {

class SystemFiles : public FileSystem {
 public:
  int open(const Path& path, int flags) override { return ::open(path.c_str(), flags | O_CLOEXEC, 0640); }
  ssize_t write(int descriptor, const void* data, std::size_t size) override { return ::write(descriptor, data, size); }
  ssize_t read(int descriptor, void* data, std::size_t size) override { return ::read(descriptor, data, size); }
  int sync(int descriptor) override { return ::fsync(descriptor); }
  int sync_all(int descriptor) override { return ::syncfs(descriptor); }
  int allocate(int descriptor, std::uint64_t size) override {
    const int error = ::posix_fallocate(descriptor, 0, static_cast<off_t>(size));
    if (error != 0) errno = error;
    return error == 0 ? 0 : -1;
  }
  int truncate(int descriptor, std::uint64_t size) override { return ::ftruncate(descriptor, static_cast<off_t>(size)); }
  int lock(int descriptor) override { return ::flock(descriptor, LOCK_EX | LOCK_NB); }
  int lock_shared(int descriptor) override { return ::flock(descriptor, LOCK_SH | LOCK_NB); }
  int close(int descriptor) override { return ::close(descriptor); }

  int rename(const Path& from, const Path& to) override { return std::rename(from.c_str(), to.c_str()); }
  int link(const Path& file, const Path& name) override { return ::link(file.c_str(), name.c_str()); }
  int remove(const Path& path) override { return std::remove(path.c_str()); }
  int make_directory(const Path& path) override { return ::mkdir(path.c_str(), 0777); }
  int close_to_others(const Path& path) override { return ::chmod(path.c_str(), 0700); }
  int status(const Path& path, Links links, struct stat& status) override {
    return links == Links::follow ? ::stat(path.c_str(), &status) : ::lstat(path.c_str(), &status);
  }
  int list(const Path& directory, std::vector<std::string>& names) override {
    DIR* entries = ::opendir(directory.c_str());
    if (entries == nullptr) return -1;
    errno = 0;
    while (const dirent* entry = ::readdir(entries)) {
      if (std::strcmp(entry->d_name, ".") != 0 && std::strcmp(entry->d_name, "..") != 0) names.emplace_back(entry->d_name);
      errno = 0;
    }
    const int error = errno;
    ::closedir(entries);
    errno = error;
    return error == 0 ? 0 : -1;
  }
  bool is_writable(const Path& path) override { return ::access(path.c_str(), W_OK) == 0; }
  std::optional<std::uint64_t> free_bytes(const Path& directory) override {
    struct statvfs disk {};
    if (::statvfs(directory.c_str(), &disk) != 0) return std::nullopt;
    return static_cast<std::uint64_t>(disk.f_bavail) * disk.f_frsize;
  }
  const char* sqlite_vfs() const override { return nullptr; }
};

}  // namespace

FileSystem& system_files() {
  static SystemFiles files;
  return files;
}

}  // namespace deform::server
