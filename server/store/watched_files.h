// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <chrono>
#include <memory>

#include "server/store/file_system.h"

namespace deform::server {

struct WatchOptions {
  std::chrono::milliseconds interval{500};   ///< between looks at the folder
  std::chrono::milliseconds patience{2000};  ///< that a look may take
};

/// The files of a folder whose file server may fall silent: on a hard mount of NFS a call then waits for ever, and with it the
/// thread that made it. A thread of its own looks at a path again and again; while that look is overdue every call that names a
/// path fails at once with ETIMEDOUT. Calls that had begun wait on. Thread-safe.
class WatchedFiles : public FileSystem {
 public:
  /// `files` outlives the look that is under way when this is destroyed, which nobody waits for.
  WatchedFiles(FileSystem& files, Path path, WatchOptions options = {});
  ~WatchedFiles() override;
  WatchedFiles(const WatchedFiles&) = delete;
  WatchedFiles& operator=(const WatchedFiles&) = delete;

  bool answers() const;

  int open(const Path& path, int flags) override;
  ssize_t write(int descriptor, const void* data, std::size_t size) override;
  ssize_t read(int descriptor, void* data, std::size_t size) override;
  int sync(int descriptor) override;
  int sync_all(int descriptor) override;
  int allocate(int descriptor, std::uint64_t size) override;
  int truncate(int descriptor, std::uint64_t size) override;
  int lock(int descriptor) override;
  int lock_shared(int descriptor) override;
  int close(int descriptor) override;
  int rename(const Path& from, const Path& to) override;
  int link(const Path& file, const Path& name) override;
  int remove(const Path& path) override;
  int make_directory(const Path& path) override;
  int close_to_others(const Path& path) override;
  int status(const Path& path, Links links, struct stat& status) override;
  int list(const Path& directory, std::vector<std::string>& names) override;
  bool is_writable(const Path& path) override;
  std::optional<std::uint64_t> free_bytes(const Path& directory) override;
  const char* sqlite_vfs() const override;

 private:
  struct Watch;
  template <typename Call>
  int unless_silent(const Call& call) const;

  FileSystem& files_;
  const std::shared_ptr<Watch> watch_;
};

}  // namespace deform::server
