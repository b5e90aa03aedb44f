// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include "client/cli/sweep/durable_file.h"

namespace deform::cli {

/// Bytes that an entry of so many bytes takes in an archive: header and padding included.
std::uint64_t tar_entry_bytes(std::uint64_t bytes);
/// Bytes that end an archive.
inline constexpr std::uint64_t tar_end_bytes = 1024;

/// The archive has an entry as TarWriter writes it, of this name and size, at this offset.
bool tar_has_entry(const DurableFile& archive, std::uint64_t offset, const std::string& name, std::uint64_t bytes);

/// Writes a POSIX ustar archive of plain files. Not thread-safe. Throws Error(failed_precondition) when the disk is full: what
/// was there before is still there, and nothing else.
class TarWriter {
 public:
  /// Goes on at `end` of an archive begun earlier: what stands behind is cut off. 0 begins a new one.
  TarWriter(const std::filesystem::path& path, std::uint64_t end);

  /// `name` at most 100 bytes. On the disk when this returns.
  void add(const std::string& name, std::string_view bytes);
  /// The content of an entry of another archive; on the disk after close().
  void add_copy(const std::string& name, const DurableFile& from, std::uint64_t offset, std::uint64_t bytes);
  /// The two empty blocks that end an archive; all of it is on the disk then.
  void close();
  /// Takes the place of `target`.
  void rename(const std::filesystem::path& target);
  std::uint64_t end() const { return end_; }

 private:
  DurableFile file_;
  std::uint64_t end_;
};

}  // namespace deform::cli
