// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "server/store/file_system.h"

namespace deform::server {

/// What a store does with files, on any FileSystem. Everything here throws Error(out_of_budget) when the disk is full and
/// Error(unavailable) with the reason of the system for other failures, unless it says that it does not.

/// An open file. One thread.
class File {
 public:
  File(FileSystem& files, const std::filesystem::path& path, int flags);
  ~File();
  File(const File&) = delete;
  File& operator=(const File&) = delete;

  void write(const void* data, std::size_t size) const;
  /// Number of bytes read; less than size only at the end of the file.
  std::size_t read(void* data, std::size_t size) const;
  void sync() const;
  /// As long as the object lives; false when another process has it.
  bool try_lock() const;

 private:
  FileSystem& files_;
  std::filesystem::path path_;
  int descriptor_;
};

/// Throws what errno says about an action on a path; clients see the path as `files` shows it.
[[noreturn]] void fail_on(const FileSystem& files, const char* action, const std::filesystem::path& path);

/// Makes a rename or removal inside the directory durable.
void sync_directory(FileSystem& files, const std::filesystem::path& directory);

/// Makes everything written to the file system of the directory durable; for many files at once.
void sync_file_system(FileSystem& files, const std::filesystem::path& directory);

/// Replaces what is there. Durable only after sync_directory().
void move_file(FileSystem& files, const std::filesystem::path& from, const std::filesystem::path& to);

/// Makes a directory and those above it that are missing; they are durable where the folder above can be opened.
void make_directories(FileSystem& files, const std::filesystem::path& directory);

/// A file, or a link that leads to one.
bool exists(FileSystem& files, const std::filesystem::path& path);
/// A file or a link, wherever it leads.
bool is_anything(FileSystem& files, const std::filesystem::path& path);
/// No link and no directory.
bool is_file(FileSystem& files, const std::filesystem::path& path);
bool is_directory(FileSystem& files, const std::filesystem::path& path);
std::uint64_t file_size(FileSystem& files, const std::filesystem::path& path);
/// What cannot be looked at is not there.
bool is_seen(FileSystem& files, const std::filesystem::path& path);

/// The full paths, sorted, so that what is done does not depend on the file system.
std::vector<std::filesystem::path> entries_of(FileSystem& files, const std::filesystem::path& directory);

/// False when it was not there.
bool remove_file(FileSystem& files, const std::filesystem::path& path);
/// The same, without ever throwing: false when it was not there or stays.
bool try_remove(FileSystem& files, const std::filesystem::path& path);

}  // namespace deform::server
