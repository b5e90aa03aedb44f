// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

namespace deform::cli {

/// A file that grows at its end, and what was synced is there after a crash. What goes wrong (a full disk, permissions) is an
/// Error(failed_precondition) naming the file. Not thread-safe.
class DurableFile {
 public:
  /// Opens it to read and to append; made when it does not exist.
  explicit DurableFile(std::filesystem::path path);
  ~DurableFile();
  DurableFile(DurableFile&& other) noexcept;
  DurableFile& operator=(DurableFile&& other) noexcept;

  const std::filesystem::path& path() const { return path_; }
  std::uint64_t size() const { return size_; }
  /// All of it, or nothing: what was written before the disk was full is cut off again.
  void append(std::string_view bytes);
  void cut(std::uint64_t size);
  /// Returns when everything is on the disk.
  void sync();
  /// At most `bytes` from `offset` on; fewer at the end.
  std::string read(std::uint64_t offset, std::size_t bytes) const;
  /// False when another process has it. Held until this closes, or the process ends however it does.
  bool lock();
  /// The file still has this name.
  bool is_current() const;
  /// Takes the place of `target`; the folder is synced.
  void rename(const std::filesystem::path& target);

 private:
  [[noreturn]] void fail(const char* what) const;

  std::filesystem::path path_;
  int descriptor_ = -1;
  std::uint64_t size_ = 0;
};

/// What was made, renamed or removed in a folder is on the disk.
void sync_folder(const std::filesystem::path& folder);

}  // namespace deform::cli
