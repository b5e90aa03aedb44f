// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/store_copy.h"

#include <fcntl.h>

#include <cerrno>

#include "core/base/error.h"
#include "server/store/store_directory.h"
#include "server/store/tenant.h"

namespace deform::server {

namespace {

namespace fs = std::filesystem;

constexpr std::size_t piece_bytes = std::size_t{1} << 20;

std::string note_of(const std::string& source) { return "deformd, unfinished copy of " + source + "\n"; }

std::string content(FileSystem& files, const fs::path& file) {
  std::string text(std::size_t{64} << 10, '\0');
  text.resize(File(files, file, O_RDONLY).read(text.data(), text.size()));
  return text;
}

bool same_bytes(FileSystem& files, const fs::path& a, const fs::path& b) {
  if (file_size(files, a) != file_size(files, b)) return false;
  const File one(files, a, O_RDONLY), other(files, b, O_RDONLY);
  std::string left(piece_bytes, '\0'), right(piece_bytes, '\0');
  for (;;) {
    const std::size_t size = one.read(left.data(), left.size());
    if (other.read(right.data(), right.size()) != size || left.compare(0, size, right, 0, size) != 0) return false;
    if (size == 0) return true;
  }
}

}  // namespace

bool StoreCopy::Version::operator==(const Version& other) const {
  return device == other.device && file == other.file && changed.tv_sec == other.changed.tv_sec &&
         changed.tv_nsec == other.changed.tv_nsec;
}

StoreCopy::StoreCopy(const fs::path& to, const std::string& source, FileSystem& files) : root_(to), files_(files) {
  const fs::path note = root_ / unfinished_copy_name, part = root_ / (std::string(unfinished_copy_name) + ".part");
  const bool begun = exists(files_, note);
  if (begun ? has_mark(root_, files_) || content(files_, note) != note_of(source) : !is_empty_folder(root_, files_)) {
    std::string advice;
    if (begun && !has_mark(root_, files_)) advice = " (it has an unfinished copy of something else)";
    if (!begun && is_interrupted_copy(root_, files_)) advice = " (if a backup or restore to it was interrupted, remove it first)";
    throw Error(ErrorCode::failed_precondition, "store: " + root_.string() + " is not empty; nothing in it was touched" + advice);
  }
  if (!begun) {
    make_directories(files_, root_);
    if (files_.close_to_others(root_) != 0) fail_on(files_, "close to others", root_);
    {
      const File file(files_, part, O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW);
      const std::string text = note_of(source);
      file.write(text.data(), text.size());
      file.sync();
    }
    move_file(files_, part, note);
    sync_directory(files_, root_);
  }
  note_ = std::make_unique<File>(files_, note, O_RDONLY);
  if (!note_->try_lock()) {
    throw Error(ErrorCode::unavailable, "store: another process makes a copy in " + root_.string());
  }
  for (const char* folder : folders) {
    if (files_.make_directory(root_ / folder) != 0 && errno != EEXIST) fail_on(files_, "create", root_ / folder);
  }
}

bool StoreCopy::take(const fs::path& from, const char* folder, const std::string& name) {
  const fs::path to = root_ / folder / name;
  struct stat about {};
  if (files_.status(from, FileSystem::Links::follow, about) != 0) {
    if (errno == ENOENT) return false;
    fail_on(files_, "look at", from);
  }
  const Version version{about.st_dev, about.st_ino, about.st_mtim};
  const auto known = taken_.find(to);
  if (known != taken_.end() && known->second == version) return true;
  try {
    while (files_.link(from, to) != 0) {
      if (errno == ENOENT) return false;
      if (errno != EEXIST) {
        copy(from, to, about);
        break;
      }
      // A file of an earlier round or run: whole, half, or what was there then.
      struct stat there {};
      const bool same_file = files_.status(to, FileSystem::Links::follow, there) == 0 && there.st_dev == about.st_dev &&
                             there.st_ino == about.st_ino;
      if (same_file || same_bytes(files_, from, to)) break;
      remove_file(files_, to);
    }
  } catch (const Error&) {
    if (exists(files_, from)) throw;
    try_remove(files_, to);  // half a copy of what was removed meanwhile
    return false;
  }
  taken_.insert_or_assign(to, version);
  return true;
}

void StoreCopy::copy(const fs::path& from, const fs::path& to, const struct stat& about) {
  if (about.st_nlink > 1) {
    const auto [known, fresh] = copies_.try_emplace({about.st_dev, about.st_ino}, to);
    const auto id = [](const fs::path& path) { return owned_id(path.filename().string())->id; };
    const bool same = id(known->second) == id(to) && known->second.parent_path() == to.parent_path();
    if (!fresh && same && files_.link(known->second, to) == 0) return;
  }
  const File source(files_, from, O_RDONLY);
  const File target(files_, to, O_WRONLY | O_CREAT | O_EXCL);
  std::string buffer(piece_bytes, '\0');
  while (const std::size_t size = source.read(buffer.data(), buffer.size())) target.write(buffer.data(), size);
}

void StoreCopy::drop_others(const char* folder, const std::set<std::string>& names) {
  for (const fs::path& path : entries_of(files_, root_ / folder)) {
    if (names.count(path.filename().string()) == 0) remove_file(files_, path);
  }
}

void StoreCopy::drop_catalog() {
  for (const char* suffix : {"", "-wal", "-shm"}) {
    const fs::path file = catalog().string() + suffix;
    if (is_anything(files_, file)) remove_file(files_, file);
  }
}

void StoreCopy::finish() {
  sync_file_system(files_, root_);
  remove_file(files_, root_ / unfinished_copy_name);
  write_mark(root_, files_);
}

}  // namespace deform::server
