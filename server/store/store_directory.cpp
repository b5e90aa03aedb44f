// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/store_directory.h"

#include <fcntl.h>
#include <spdlog/spdlog.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <iterator>

#include "core/base/error.h"
#include "server/store/catalog_records.h"
#include "server/store/file.h"
#include "server/store/sqlite_files.h"

namespace deform::server {

namespace {

namespace fs = std::filesystem;

constexpr const char* mark_name = "deformd-store";
/// Format 3 has tenants in the names of files, which a server of format 2 would take for a stranger's.
constexpr const char* mark_text = "deformd store, format 3\n";
constexpr const char* mark_of_2 = "deformd store, format 2\n";  // the files of the default tenant alone: a format 3 as it stands
/// Of the file systems themselves, of a mark that was not finished, and the lock, which is made before the mark.
constexpr std::array nothing_of_anybody = {"lost+found", "deformd-store.part", "lock"};
constexpr std::array layout = {"lock",    "geometries", "names",   "setups",     "tmp",
                               "damaged", "unclaimed",  "reserve", "lost+found", "deformd-store.part"};

/// A file in geometries/ that is named as those of a store are.
bool has_a_geometry(const fs::path& root) {
  const fs::path folder = root / "geometries";
  return fs::is_directory(folder) && std::any_of(fs::directory_iterator(folder), fs::directory_iterator(), [](const auto& entry) {
           return owned_id(entry.path().filename().string()) && fs::is_regular_file(entry.symlink_status());
         });
}

Error not_a_store(const fs::path& root) {
  std::string message = "store: " + root.string() + " is not empty and not a store of deformd (it has no file \"" + mark_name +
                        "\"); nothing in it was touched. Name an empty or a new folder";
  if (has_a_geometry(root)) {
    message += "; if this is a store that lost files, \"deformd store rebuild --data-dir " + root.string() + "\" makes one of it";
  }
  return {ErrorCode::failed_precondition, message};
}

template <typename Names>
bool is_among(const Names& names, const fs::path& name) {
  return std::find(names.begin(), names.end(), name.string()) != names.end();
}

bool laid_out_like_a_store(const fs::path& root) {
  return has_a_geometry(root) && std::all_of(fs::directory_iterator(root), fs::directory_iterator(), [](const auto& entry) {
           const fs::path name = entry.path().filename();
           return is_among(layout, name) || name.string().starts_with("catalog.sqlite");
         });
}

std::string content(const fs::path& file) {
  std::string text(std::strlen(mark_text) + 100, '\0');
  text.resize(File(file, O_RDONLY).read(text.data(), text.size()));
  return text;
}

/// Before anything is written: is this folder one that we may use?
void examine(const fs::path& root, StoreDirectory::Accept accept) {
  if (!fs::exists(root) && accept != StoreDirectory::Accept::existing) return;
  if (has_mark(root)) {
    const std::string text = content(root / mark_name);
    if (text == mark_text || text == mark_of_2) return;
    throw Error(ErrorCode::failed_precondition, "store: " + root.string() + " is of another version (\"" +
                                                    text.substr(0, text.find('\n')) + "\"), this server knows \"" +
                                                    std::string(mark_text, std::strlen(mark_text) - 1) + "\"");
  }
  if (accept == StoreDirectory::Accept::existing) {
    throw Error(ErrorCode::failed_precondition,
                "store: " + root.string() + " is not a store of deformd (it has no file \"" + mark_name + "\")");
  }
  if (is_empty_folder(root) || is_catalog_of_0_1(root / "catalog.sqlite")) return;
  if (accept == StoreDirectory::Accept::also_files && laid_out_like_a_store(root)) return;
  throw not_a_store(root);
}

int lock(const fs::path& root) {
  const fs::path file = root / "lock";
  const int descriptor = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0640);
  if (descriptor < 0) fail_on("open", file);
  if (::flock(descriptor, LOCK_EX | LOCK_NB) != 0) {
    ::close(descriptor);
    throw Error(ErrorCode::unavailable, "store: the data directory " + root.string() + " is in use by another process");
  }
  return descriptor;
}

void make_folder(const fs::path& path) {
  std::error_code error;
  fs::create_directories(path, error);
  if (error) throw Error(ErrorCode::unavailable, "store: cannot create " + path.string() + ": " + error.message());
}

}  // namespace

StoreDirectory::StoreDirectory(const fs::path& root, Accept accept) : root_(root) {
  try {
    examine(root, accept);
    make_folder(root);
    lock_descriptor_ = lock(root);
    examine(root, accept);  // another process may have been faster
    if (!has_mark(root)) {
      // What users register is for nobody else on this machine.
      if (::chmod(root.c_str(), 0700) != 0)
        spdlog::warn("store: cannot close {} to others: {}", root.string(), std::strerror(errno));
      // A catalog of 0.1 is marked and then migrated, its copy made first: without the mark, a migrated one would be nobody's.
      const fs::path copy = catalog().string() + ".schema-1";
      if (is_catalog_of_0_1(catalog()) && !fs::exists(copy)) {
        try {
          copy_catalog(catalog(), copy);
        } catch (const Error& error) {
          if (error.code() != ErrorCode::data_loss) throw;  // a damaged one is set aside whole, later
        }
      }
      write_mark(root);
      spdlog::info("store: {} is now a store of deformd", root.string());
    } else if (content(root / mark_name) == mark_of_2) {
      write_mark(root);  // before the catalog is changed, which an older server would not understand
    }
    for (const fs::path& folder : {geometries(), names(), setups(), tmp(), damaged(), unclaimed()}) make_folder(folder);
    sync_directory(root);
  } catch (const fs::filesystem_error& error) {
    if (lock_descriptor_ >= 0) ::close(lock_descriptor_);
    throw Error(ErrorCode::unavailable, std::string("store: ") + error.what());
  } catch (...) {
    if (lock_descriptor_ >= 0) ::close(lock_descriptor_);
    throw;
  }
}

StoreDirectory::~StoreDirectory() { ::close(lock_descriptor_); }

fs::path StoreDirectory::temporary(const std::string& key, std::int64_t intent) const {
  return tmp() / (key + "." + std::to_string(intent));
}

fs::path StoreDirectory::temporary_link(const std::string& key, std::int64_t intent) const {
  return tmp() / (key + "." + std::to_string(intent) + ".link");
}

fs::path StoreDirectory::temporary_record(const std::string& key, std::int64_t intent) const {
  return tmp() / (key + "." + std::to_string(intent) + ".record");
}

fs::path StoreDirectory::set_aside(const fs::path& file, const fs::path& shelf) const {
  for (int number = 0;; ++number) {
    std::string name = file.filename().string();
    if (number > 0) name.append(".").append(std::to_string(number));
    const fs::path to = shelf / name;
    // Not fs::exists(): a link that leads nowhere is something, too. Only this process writes here.
    if (fs::symlink_status(to).type() != fs::file_type::not_found) continue;
    move_file(file, to);
    sync_directory(shelf);
    sync_directory(file.parent_path());
    return to;
  }
}

bool has_mark(const fs::path& root) {
  std::error_code error;
  return fs::is_regular_file(fs::symlink_status(root / mark_name, error));
}

void write_mark(const fs::path& root) {
  const fs::path part = root / (std::string(mark_name) + ".part");
  {
    const File file(part, O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW);
    file.write(mark_text, std::strlen(mark_text));
    file.sync();
  }
  move_file(part, root / mark_name);
  sync_directory(root);
}

bool is_empty_folder(const fs::path& folder) {
  if (!fs::exists(folder)) return true;
  return std::all_of(fs::directory_iterator(folder), fs::directory_iterator(),
                     [](const auto& entry) { return is_among(nothing_of_anybody, entry.path().filename()); });
}

fs::path StoreDirectory::set_aside_catalog() const {
  for (int number = 0;; ++number) {
    const fs::path folder = damaged() / ("catalog." + std::to_string(number));
    std::error_code error;
    if (!fs::create_directory(folder, error)) {
      if (error) throw Error(ErrorCode::unavailable, "store: cannot create " + folder.string() + ": " + error.message());
      continue;  // an earlier one
    }
    for (const char* suffix : {"", "-wal", "-shm"}) {
      const fs::path file = catalog().string() + suffix;
      if (fs::symlink_status(file).type() != fs::file_type::not_found) move_file(file, folder / file.filename());
    }
    for (const fs::path& changed : {folder, damaged(), root_}) sync_directory(changed);
    return folder / catalog().filename();
  }
}

std::size_t count_entries(const fs::path& folder) {
  std::error_code error;
  const fs::directory_iterator entries(folder, error);
  return error ? 0 : static_cast<std::size_t>(std::distance(fs::begin(entries), fs::end(entries)));
}

}  // namespace deform::server
