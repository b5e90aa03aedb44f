// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <mutex>
#include <string>

#include "server/store/file_system.h"

namespace deform::server {

struct DiskOptions {
  /// Bytes that stay free on the disk: nothing is added to the store below. A part of them is held by a file, so that deleting
  /// works also where another program took the rest.
  std::uint64_t keep_free = std::uint64_t{16} << 20;
  /// Bytes free on the disk; empty: asks the system.
  std::function<std::uint64_t()> free_bytes;
};

/// The disk of a store. Thread-safe.
class DiskSpace {
 public:
  DiskSpace(const std::filesystem::path& folder, const std::filesystem::path& reserve, DiskOptions options,
            FileSystem& files = system_files());

  std::uint64_t free() const;
  std::uint64_t keep_free() const { return options_.keep_free; }
  /// Empty when the store may be added to; else one clause that says why not.
  std::string refusal(std::uint64_t bytes = 0) const;
  /// Throws Error(out_of_budget) when so many bytes cannot be added.
  void require(std::uint64_t bytes) const;

  /// While it lives, the disk has the file's space when it has little else: room for what makes room.
  class Room {
   public:
    explicit Room(DiskSpace& space) : space_(space) { space_.lend(); }
    ~Room() { space_.take_back(); }
    Room(const Room&) = delete;
    Room& operator=(const Room&) = delete;

   private:
    DiskSpace& space_;
  };
  /// Fills the file again as far as the disk has room, unless a Room is open.
  void hold();

 private:
  FileSystem& files_;
  const std::filesystem::path folder_, reserve_;
  const DiskOptions options_;
  const std::uint64_t most_;
  void lend();
  void take_back();
  void fill();

  std::mutex mutex_;
  // under mutex_
  std::uint64_t held_ = 0;
  int rooms_ = 0;
};

}  // namespace deform::server
