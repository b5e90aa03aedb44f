// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "server/store/file_system.h"

namespace deform::server {

/// How clients see the files of a store.
enum class Naming {
  in_full,           ///< whoever asks looks after the store
  below_the_folder,  ///< "geometries/1a2b": where the store is on its machine is nobody's business
};

/// How many syncs took how long, as a histogram.
struct SyncTimes {
  static constexpr std::array bounds = {0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0};  ///< s
  std::array<std::uint64_t, bounds.size() + 1> counts{};  ///< those of at most so long, and longer than the bound before
  double seconds = 0;                                     ///< of all

  void add(double time);
};

/// The files of one store, on any FileSystem. Thread-safe as that is.
class StoreFiles final : public FileSystem {
 public:
  /// `files` outlives this; `folder` is that of the store.
  StoreFiles(FileSystem& files, const Path& folder, Naming naming);

  /// Below the folder as of its entries; the folder itself is "the data directory". Other paths are shown as they are: their
  /// folders are those that the client has named, as of a backup.
  std::string shown(const Path& path) const override;

  int open(const Path& path, int flags) override { return files_.open(path, flags); }
  ssize_t write(int descriptor, const void* data, std::size_t size) override { return files_.write(descriptor, data, size); }
  ssize_t read(int descriptor, void* data, std::size_t size) override { return files_.read(descriptor, data, size); }
  int sync(int descriptor) override {
    return timed([&] { return files_.sync(descriptor); });
  }
  int sync_all(int descriptor) override {
    return timed([&] { return files_.sync_all(descriptor); });
  }
  int allocate(int descriptor, std::uint64_t size) override { return files_.allocate(descriptor, size); }
  int truncate(int descriptor, std::uint64_t size) override { return files_.truncate(descriptor, size); }
  int lock(int descriptor) override { return files_.lock(descriptor); }
  int lock_shared(int descriptor) override { return files_.lock_shared(descriptor); }
  int close(int descriptor) override { return files_.close(descriptor); }
  int rename(const Path& from, const Path& to) override { return files_.rename(from, to); }
  int link(const Path& file, const Path& name) override { return files_.link(file, name); }
  int remove(const Path& path) override { return files_.remove(path); }
  int make_directory(const Path& path) override { return files_.make_directory(path); }
  int close_to_others(const Path& path) override { return files_.close_to_others(path); }
  int status(const Path& path, Links links, struct stat& status) override { return files_.status(path, links, status); }
  int list(const Path& directory, std::vector<std::string>& names) override { return files_.list(directory, names); }
  bool is_writable(const Path& path) override { return files_.is_writable(path); }
  std::optional<std::uint64_t> free_bytes(const Path& directory) override { return files_.free_bytes(directory); }
  const char* sqlite_vfs() const override { return files_.sqlite_vfs(); }

  /// The calls of sync() and sync_all() so far, those that failed included. What SQLite syncs goes another way.
  SyncTimes sync_times() const;

 private:
  int timed(const std::function<int()>& sync);

  FileSystem& files_;
  const Path folder_, real_folder_;  ///< without a slash at their end; where links lead
  const Naming naming_;
  mutable std::mutex times_mutex_;
  SyncTimes times_;  // under times_mutex_
};

}  // namespace deform::server
