// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <filesystem>

namespace deform::server {

/// An open file. Everything here throws Error(out_of_budget) when the disk is full and Error(unavailable) with the reason of the
/// system for other failures. One thread.
class File {
 public:
  File(const std::filesystem::path& path, int flags);
  ~File();
  File(const File&) = delete;
  File& operator=(const File&) = delete;

  void write(const void* data, std::size_t size) const;
  /// Number of bytes read; less than size only at the end of the file.
  std::size_t read(void* data, std::size_t size) const;
  void sync() const;

 private:
  std::filesystem::path path_;
  int descriptor_;
};

/// Throws what errno says about an action on a path.
[[noreturn]] void fail_on(const char* action, const std::filesystem::path& path);

/// Makes a rename or removal inside the directory durable.
void sync_directory(const std::filesystem::path& directory);

/// Makes everything written to the file system of the directory durable; for many files at once.
void sync_file_system(const std::filesystem::path& directory);

/// Replaces what is there. Durable only after sync_directory().
void move_file(const std::filesystem::path& from, const std::filesystem::path& to);

}  // namespace deform::server
