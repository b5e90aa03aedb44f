// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <sys/stat.h>
#include <sys/types.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace deform::server {

/// Everything that a store asks of its disk; what SQLite asks goes through the VFS that is named here. The calls are those of the
/// system, and fail like them: with -1 and errno. Thread-safe. Tests give a store a disk in memory that forgets, fills up and
/// fails.
class FileSystem {
 public:
  using Path = std::filesystem::path;
  enum class Links { follow, stay };

  virtual ~FileSystem() = default;

  // ---- open files ----
  /// A descriptor, closed when a program is executed; new files have mode 0640.
  virtual int open(const Path& path, int flags) = 0;
  virtual ssize_t write(int descriptor, const void* data, std::size_t size) = 0;
  virtual ssize_t read(int descriptor, void* data, std::size_t size) = 0;
  virtual int sync(int descriptor) = 0;
  /// Everything written to the file system of an open file or directory.
  virtual int sync_all(int descriptor) = 0;
  /// Takes room on the disk so that the file has at least that size.
  virtual int allocate(int descriptor, std::uint64_t size) = 0;
  virtual int truncate(int descriptor, std::uint64_t size) = 0;
  /// Against all who ask for the same; does not wait. Until the descriptor is closed.
  virtual int lock(int descriptor) = 0;
  /// Against those who ask for lock() only.
  virtual int lock_shared(int descriptor) = 0;
  virtual int close(int descriptor) = 0;

  // ---- names ----
  virtual int rename(const Path& from, const Path& to) = 0;
  virtual int link(const Path& file, const Path& name) = 0;
  /// A file or an empty directory.
  virtual int remove(const Path& path) = 0;
  virtual int make_directory(const Path& path) = 0;
  /// Mode 0700.
  virtual int close_to_others(const Path& path) = 0;
  virtual int status(const Path& path, Links links, struct stat& status) = 0;
  /// Without "." and "..", in any order.
  virtual int list(const Path& directory, std::vector<std::string>& names) = 0;
  virtual bool is_writable(const Path& path) = 0;
  /// Bytes that this user may still write; nothing when that is unknown.
  virtual std::optional<std::uint64_t> free_bytes(const Path& directory) = 0;

  /// How a path looks to those who may read what is said about it.
  virtual std::string shown(const Path& path) const { return path.string(); }

  /// The name of the VFS of SQLite; null: the one that SQLite takes by itself.
  virtual const char* sqlite_vfs() const = 0;
};

/// The one of this machine.
FileSystem& system_files();

}  // namespace deform::server
