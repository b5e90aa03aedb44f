// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/file.h"

#include <fcntl.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string>

#include "core/base/error.h"

namespace deform::server {

namespace {

enum class Look { found, nothing };

Look look(FileSystem& files, const std::filesystem::path& path, FileSystem::Links links, struct stat& status) {
  if (files.status(path, links, status) == 0) return Look::found;
  if (errno != ENOENT && errno != ENOTDIR) fail_on(files, "look at", path);
  return Look::nothing;
}

}  // namespace

void fail_on(const FileSystem& files, const char* action, const std::filesystem::path& path) {
  const int error = errno;
  const bool full = error == ENOSPC || error == EDQUOT;
  const auto message = [&](const std::string& name) {
    return std::string("store: cannot ") + action + " " + name + ": " + std::strerror(error);
  };
  throw Error(full ? ErrorCode::out_of_budget : ErrorCode::unavailable, message(path.string()))
      .with_public_message(message(files.shown(path)))
      .refused_for(full ? Refusal::disk : Refusal::none);
}

File::File(FileSystem& files, const std::filesystem::path& path, int flags)
    : files_(files), path_(path), descriptor_(files.open(path, flags)) {
  if (descriptor_ < 0) fail_on(files, "open", path);
}

File::~File() { files_.close(descriptor_); }

void File::write(const void* data, std::size_t size) const {
  const auto* from = static_cast<const char*>(data);
  while (size > 0) {
    const ssize_t written = files_.write(descriptor_, from, std::min<std::size_t>(size, 1u << 30));
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) fail_on(files_, "write", path_);
    from += written;
    size -= static_cast<std::size_t>(written);
  }
}

std::size_t File::read(void* data, std::size_t size) const {
  auto* to = static_cast<char*>(data);
  std::size_t total = 0;
  while (total < size) {
    const ssize_t got = files_.read(descriptor_, to + total, std::min<std::size_t>(size - total, 1u << 30));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) fail_on(files_, "read", path_);
    if (got == 0) break;
    total += static_cast<std::size_t>(got);
  }
  return total;
}

void File::sync() const {
  if (files_.sync(descriptor_) != 0) fail_on(files_, "sync", path_);
}

bool File::try_lock() const {
  if (files_.lock(descriptor_) == 0) return true;
  if (errno != EWOULDBLOCK) fail_on(files_, "lock", path_);
  return false;
}

void sync_directory(FileSystem& files, const std::filesystem::path& directory) {
  File(files, directory, O_RDONLY | O_DIRECTORY).sync();
}

void sync_file_system(FileSystem& files, const std::filesystem::path& directory) {
  const int descriptor = files.open(directory, O_RDONLY | O_DIRECTORY);
  const int result = descriptor < 0 ? -1 : files.sync_all(descriptor);
  const int error = errno;
  if (descriptor >= 0) files.close(descriptor);
  errno = error;
  if (result != 0) fail_on(files, "sync", directory);
}

void move_file(FileSystem& files, const std::filesystem::path& from, const std::filesystem::path& to) {
  if (files.rename(from, to) != 0) fail_on(files, "move", from);
}

void make_directories(FileSystem& files, const std::filesystem::path& directory) {
  if (is_directory(files, directory)) return;
  const std::filesystem::path full =
      directory.has_filename() ? directory : directory.parent_path();  // "data/" has no name of its own
  std::filesystem::path above = full.parent_path();
  if (above.empty()) above = ".";
  if (!is_directory(files, above)) make_directories(files, above);
  if (files.make_directory(full) != 0) {
    if (errno != EEXIST) fail_on(files, "create", full);
  } else if (const int descriptor = files.open(above, O_RDONLY | O_DIRECTORY); descriptor >= 0) {
    files.close(descriptor);  // else it is one that this user may pass through, but not look into
    sync_directory(files, above);
  }
  if (!is_directory(files, full)) {
    errno = ENOTDIR;
    fail_on(files, "create", full);
  }
}

bool exists(FileSystem& files, const std::filesystem::path& path) {
  struct stat status {};
  return look(files, path, FileSystem::Links::follow, status) == Look::found;
}

bool is_anything(FileSystem& files, const std::filesystem::path& path) {
  struct stat status {};
  return look(files, path, FileSystem::Links::stay, status) == Look::found;
}

bool is_file(FileSystem& files, const std::filesystem::path& path) {
  struct stat status {};
  return look(files, path, FileSystem::Links::stay, status) == Look::found && S_ISREG(status.st_mode);
}

bool is_directory(FileSystem& files, const std::filesystem::path& path) {
  struct stat status {};
  return look(files, path, FileSystem::Links::follow, status) == Look::found && S_ISDIR(status.st_mode);
}

std::uint64_t file_size(FileSystem& files, const std::filesystem::path& path) {
  struct stat status {};
  if (files.status(path, FileSystem::Links::follow, status) != 0) fail_on(files, "look at", path);
  return static_cast<std::uint64_t>(status.st_size);
}

bool is_seen(FileSystem& files, const std::filesystem::path& path) {
  struct stat status {};
  return files.status(path, FileSystem::Links::follow, status) == 0;
}

std::vector<std::filesystem::path> entries_of(FileSystem& files, const std::filesystem::path& directory) {
  std::vector<std::string> names;
  if (files.list(directory, names) != 0) fail_on(files, "list", directory);
  std::sort(names.begin(), names.end());
  std::vector<std::filesystem::path> paths;
  for (const auto& name : names) paths.push_back(directory / name);
  return paths;
}

bool remove_file(FileSystem& files, const std::filesystem::path& path) {
  if (files.remove(path) == 0) return true;
  if (errno != ENOENT) fail_on(files, "remove", path);
  return false;
}

bool try_remove(FileSystem& files, const std::filesystem::path& path) { return files.remove(path) == 0; }

}  // namespace deform::server
