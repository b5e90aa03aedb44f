// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/watched_files.h"

#include <cerrno>
#include <condition_variable>
#include <mutex>
#include <thread>
#include <utility>

namespace deform::server {

/// Outlives a look that does not come back.
struct WatchedFiles::Watch {
  using Clock = std::chrono::steady_clock;

  Watch(FileSystem& of_files, Path of_path, WatchOptions of_options)
      : files(of_files), path(std::move(of_path)), options(of_options) {}

  void run() {
    std::unique_lock lock(mutex);
    while (!ending) {
      looks_since = Clock::now();
      lock.unlock();
      struct stat status;
      files.free_bytes(path);  // what no cache of this machine answers
      files.status(path, Links::follow, status);
      lock.lock();
      looks_since.reset();
      changed.wait_for(lock, options.interval, [this] { return ending; });
    }
  }

  bool answers() const {
    const std::lock_guard lock(mutex);
    return !looks_since || Clock::now() - *looks_since <= options.patience;
  }

  FileSystem& files;
  const Path path;
  const WatchOptions options;
  mutable std::mutex mutex;
  std::condition_variable changed;
  // under mutex
  std::optional<Clock::time_point> looks_since;
  bool ending = false;
};

WatchedFiles::WatchedFiles(FileSystem& files, Path path, WatchOptions options)
    : files_(files), watch_(std::make_shared<Watch>(files, std::move(path), options)) {
  std::thread([watch = watch_] { watch->run(); }).detach();
}

WatchedFiles::~WatchedFiles() {
  const std::lock_guard lock(watch_->mutex);
  watch_->ending = true;
  watch_->changed.notify_all();
}

bool WatchedFiles::answers() const { return watch_->answers(); }

template <typename Call>
int WatchedFiles::unless_silent(const Call& call) const {
  if (answers()) return call();
  errno = ETIMEDOUT;
  return -1;
}

int WatchedFiles::open(const Path& path, int flags) {
  return unless_silent([&] { return files_.open(path, flags); });
}
int WatchedFiles::rename(const Path& from, const Path& to) {
  return unless_silent([&] { return files_.rename(from, to); });
}
int WatchedFiles::link(const Path& file, const Path& name) {
  return unless_silent([&] { return files_.link(file, name); });
}
int WatchedFiles::remove(const Path& path) {
  return unless_silent([&] { return files_.remove(path); });
}
int WatchedFiles::make_directory(const Path& path) {
  return unless_silent([&] { return files_.make_directory(path); });
}
int WatchedFiles::close_to_others(const Path& path) {
  return unless_silent([&] { return files_.close_to_others(path); });
}
int WatchedFiles::status(const Path& path, Links links, struct stat& status) {
  return unless_silent([&] { return files_.status(path, links, status); });
}
int WatchedFiles::list(const Path& directory, std::vector<std::string>& names) {
  return unless_silent([&] { return files_.list(directory, names); });
}
bool WatchedFiles::is_writable(const Path& path) { return answers() && files_.is_writable(path); }
std::optional<std::uint64_t> WatchedFiles::free_bytes(const Path& directory) {
  return answers() ? files_.free_bytes(directory) : std::nullopt;
}

ssize_t WatchedFiles::write(int descriptor, const void* data, std::size_t size) { return files_.write(descriptor, data, size); }
ssize_t WatchedFiles::read(int descriptor, void* data, std::size_t size) { return files_.read(descriptor, data, size); }
int WatchedFiles::sync(int descriptor) { return files_.sync(descriptor); }
int WatchedFiles::sync_all(int descriptor) { return files_.sync_all(descriptor); }
int WatchedFiles::allocate(int descriptor, std::uint64_t size) { return files_.allocate(descriptor, size); }
int WatchedFiles::truncate(int descriptor, std::uint64_t size) { return files_.truncate(descriptor, size); }
int WatchedFiles::lock(int descriptor) { return files_.lock(descriptor); }
int WatchedFiles::lock_shared(int descriptor) { return files_.lock_shared(descriptor); }
int WatchedFiles::close(int descriptor) { return files_.close(descriptor); }
const char* WatchedFiles::sqlite_vfs() const { return files_.sqlite_vfs(); }

}  // namespace deform::server
