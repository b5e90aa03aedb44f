// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/codec/geometry_id.h"
#include "server/store/disk_space.h"
#include "server/store/file.h"
#include "server/store/store_directory.h"
#include "server/store/tenant.h"

namespace deform::server {

/// One file of BasisFiles, being read: as many bytes as were written. One thread.
class BasisFileReader {
 public:
  BasisFileReader(FileSystem& files, const std::filesystem::path& path, const std::string& key);
  std::uint64_t size() const { return size_; }
  /// Throws Error(data_loss) beyond the end.
  void read(void* data, std::size_t size);
  /// Reads what is left. Throws Error(data_loss) unless all bytes are those that were written under this name: only then may they
  /// be believed.
  void verify();

 private:
  const File file_;
  std::uint64_t size_ = 0, left_ = 0;
  codec::Sha256 hash_;
};

/// What prepared systems leave to those who need them next, in bases/ of a store: files named after tenant and system, immutable,
/// with the SHA-256 of name and content at the end. They are a cache on disk: no catalog names them, each can be made again by
/// preparing its system, and the oldest give way to new ones and to what is registered. Several servers may use one folder.
/// Thread-safe; no lock is held while bytes are written or read. Only put() and open() throw.
class BasisFiles {
 public:
  using Sink = std::function<void(const void* data, std::size_t size)>;

  /// `most`: bytes of all files; 0: nothing is written. The others outlive this.
  BasisFiles(const StoreDirectory& directory, const DiskSpace& disk, std::uint64_t most);

  /// At a start, of a folder that nobody else uses (or `alone` is Alone::no, then only after a day): files whose writer is gone.
  enum class Alone { yes, no };
  void sweep(Alone alone);

  bool wanted() const { return most_ > 0; }
  /// Whether there is a file of that name; not whether it is whole.
  bool contains(const OwnedId& system) const;

  /// Writes `bytes` bytes, which `write` hands to its sink, synced before they get their name; what is there stays. The oldest
  /// files go first where there would be more than allowed. Throws Error(out_of_budget) where there is no room on the disk or
  /// within `most`, the errors of the context, and those of a File; nothing is left behind then.
  void put(const OwnedId& system, std::uint64_t bytes, const std::function<void(const Sink&)>& write, const RunContext& context);

  /// Null when there is none.
  std::unique_ptr<BasisFileReader> open(const OwnedId& system) const;

  void remove(const OwnedId& system) const { remove(directory_, system); }
  static void remove(const StoreDirectory& directory, const OwnedId& system);
  /// Out of the way, so that the next preparation writes a good one.
  void set_aside(const OwnedId& system) const;
  /// Removes the oldest files until so many bytes can be added to the store, where that is possible.
  void make_room(std::uint64_t bytes) const;

  /// What all have, and one tenant.
  std::uint64_t bytes() const;
  std::uint64_t bytes_of(const std::string& tenant) const;

  /// A line for each damaged file; how many there are.
  std::size_t check(const RunContext& context,
                    const std::function<void(const OwnedId& system, const std::string& why)>& damaged) const;

 private:
  struct Entry {
    OwnedId system;
    std::filesystem::path path;
    std::uint64_t bytes = 0;
    std::int64_t modified_ns = 0;
  };
  std::vector<Entry> entries() const;
  std::filesystem::path path_of(const OwnedId& system) const;
  std::filesystem::path part_of(const OwnedId& system);
  void evict_down_to(std::uint64_t bytes) const;

  const StoreDirectory& directory_;
  const DiskSpace& disk_;
  const std::uint64_t most_;
  FileSystem& files_;
  const std::string writer_;  ///< a part of the names of files that are being written: other ones on every server
  std::atomic<std::uint64_t> parts_{0};
  mutable std::mutex aside_mutex_;
};

}  // namespace deform::server
