// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "server/store/file_system.h"

namespace deform::server {

/// One of several servers on a disk and a database that go on without it. A point is any call of its file system and of the
/// catalog: where it sees what others do, and they what it does. Thread-safe, while nobody changes what it is to do.
class SimulatedServer {
 public:
  enum class Loss {
    none,
    call,   ///< the call had no effect
    answer  ///< the call had its effect
  };

  std::uint64_t points() const { return points_; }
  /// From this point on the server does nothing any more: its process was killed.
  std::uint64_t stops_at = UINT64_MAX;
  bool stopped() const { return stopped_; }
  void stop() { stopped_ = true; }

  /// Called before each point; what others do there, they do between two steps of this server.
  std::function<void()> before_point;
  /// The fate of each call of the catalog; empty: none is lost.
  std::function<Loss()> catalog_fault;

  /// Whether the point is reached alive.
  bool reaches_point();

 private:
  std::atomic<std::uint64_t> points_{0};
  std::atomic<bool> stopped_{false};
};

/// The files of a disk as one server sees them.
class ServerFiles : public FileSystem {
 public:
  /// Both outlive this.
  ServerFiles(FileSystem& disk, SimulatedServer& server) : disk_(disk), server_(server) {}

  int open(const Path& path, int flags) override;
  ssize_t write(int descriptor, const void* data, std::size_t size) override;
  ssize_t read(int descriptor, void* data, std::size_t size) override;
  int sync(int descriptor) override;
  int sync_all(int descriptor) override;
  int allocate(int descriptor, std::uint64_t size) override;
  int truncate(int descriptor, std::uint64_t size) override;
  int lock(int descriptor) override;
  int lock_shared(int descriptor) override;
  int close(int descriptor) override { return disk_.close(descriptor); }  // the system does it for those that are gone
  int rename(const Path& from, const Path& to) override;
  int link(const Path& file, const Path& name) override;
  int remove(const Path& path) override;
  int make_directory(const Path& path) override;
  int close_to_others(const Path& path) override;
  int status(const Path& path, Links links, struct stat& status) override;
  int list(const Path& directory, std::vector<std::string>& names) override;
  bool is_writable(const Path& path) override { return disk_.is_writable(path); }
  std::optional<std::uint64_t> free_bytes(const Path& directory) override { return disk_.free_bytes(directory); }
  const char* sqlite_vfs() const override { return disk_.sqlite_vfs(); }

 private:
  /// Counts; errno is set when the server has stopped. What the disk refuses, it refuses to all.
  bool fails();

  FileSystem& disk_;
  SimulatedServer& server_;
};

}  // namespace deform::server
