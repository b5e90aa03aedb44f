// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/store_directory.h"

#include <fcntl.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "core/base/error.h"
#include "core/codec/geometry_id.h"
#include "server/store/catalog_records.h"
#include "server/store/file.h"
#include "server/store/sqlite_files.h"

namespace deform::server {

namespace {

namespace fs = std::filesystem;

constexpr const char* mark_name = "deformd-store";
/// Format 3 has tenants in the names of files, which a server of format 2 would take for a stranger's.
constexpr const char* mark_text = "deformd store, format 3\n";
constexpr const char* shared_mark_text = "deformd store, format 3, shared by servers with the catalog ";
constexpr const char* mark_of_2 = "deformd store, format 2\n";  // the files of the default tenant alone: a format 3 as it stands
/// Names that belong to file systems or to a mark that was not finished, and the lock, which is made before the mark.
constexpr std::array nothing_of_anybody = {"lost+found", "deformd-store.part", "lock", "deformd-unfinished-copy.part"};
constexpr std::array layout = {"lock",
                               "geometries",
                               "names",
                               "setups",
                               "bases",
                               "tmp",
                               "damaged",
                               "unclaimed",
                               "reserve",
                               "lost+found",
                               mark_name,
                               unfinished_copy_name,
                               "deformd-store.part"};

/// A file in geometries/ that is named as those of a store are.
bool has_a_geometry(const fs::path& root, FileSystem& files) {
  const fs::path folder = root / "geometries";
  if (!is_directory(files, folder)) return false;
  const auto entries = entries_of(files, folder);
  return std::any_of(entries.begin(), entries.end(),
                     [&](const fs::path& path) { return owned_id(path.filename().string()) && is_file(files, path); });
}

Error not_a_store(const fs::path& root, FileSystem& files) {
  std::string message = "store: " + root.string() + " is not empty and not a store of deformd (it has no file \"" + mark_name +
                        "\"); nothing in it was touched. Name an empty or a new folder";
  if (has_a_geometry(root, files)) {
    message += "; if this is a store that lost files, \"deformd store rebuild --data-dir " + root.string() +
               "\" makes one of it; if a backup or restore to it was interrupted, begin it again";
  }
  return {ErrorCode::failed_precondition, message};
}

template <typename Names>
bool is_among(const Names& names, const fs::path& name) {
  return std::find(names.begin(), names.end(), name.string()) != names.end();
}

bool has_only_what_stores_have(const fs::path& root, FileSystem& files) {
  const auto entries = entries_of(files, root);
  return std::all_of(entries.begin(), entries.end(), [](const fs::path& path) {
    return is_among(layout, path.filename()) || path.filename().string().starts_with("catalog.sqlite");
  });
}

bool laid_out_like_a_store(const fs::path& root, FileSystem& files) {
  return has_a_geometry(root, files) && has_only_what_stores_have(root, files);
}

/// Whether it is the mark of a store of a later version, which has the SHA-256 of its first line on a second one: one flipped bit
/// makes 7 of 3.
bool names_a_later_format(const std::string& mark) {
  const std::size_t line = mark.find('\n') + 1;
  if (!mark.starts_with("deformd store, format ") || line == 0) return false;
  codec::Sha256 digest;
  digest.add(mark.data(), line);
  return mark.substr(line) == digest.hex() + "\n";
}

std::string content(const fs::path& file, FileSystem& files) {
  std::string text(200, '\0');
  text.resize(File(files, file, O_RDONLY).read(text.data(), text.size()));
  return text;
}

std::string mark_of(const std::string& catalog) { return catalog.empty() ? mark_text : shared_mark_text + catalog + "\n"; }

/// Before anything is written: is this folder one that we may use?
void examine(const fs::path& root, StoreDirectory::Accept accept, const std::string& mark, FileSystem& files) {
  const bool alone = mark == mark_text;
  if (!exists(files, root) && accept != StoreDirectory::Accept::existing) return;
  if (has_mark(root, files)) {
    const std::string text = content(root / mark_name, files);
    if (text == mark || (alone && text == mark_of_2)) return;
    const bool shared = text.starts_with(shared_mark_text);
    if (alone && shared) {
      throw Error(ErrorCode::failed_precondition,
                  "store: " + root.string() +
                      " is shared by servers whose catalog is in PostgreSQL (option catalog); nothing "
                      "in it was touched");
    }
    if (!alone && shared) {
      throw Error(ErrorCode::failed_precondition,
                  "store: the files in " + root.string() +
                      " belong to another catalog than that of the option catalog; nothing in it was "
                      "touched");
    }
    if (!alone && (text == mark_text || text == mark_of_2)) {
      throw Error(ErrorCode::failed_precondition,
                  "store: " + root.string() +
                      " is the store of one server, with a catalog of its own; for servers that share "
                      "a catalog name an empty or a new folder, and bring what is here there by \"deformd store import\"");
    }
    if (!names_a_later_format(text)) {
      const std::string damaged = "store: the mark " + (root / mark_name).string() + " is damaged";
      if (!alone) throw Error(ErrorCode::failed_precondition, damaged + "; restore it from a backup of the folder");
      if (accept == StoreDirectory::Accept::also_files && has_only_what_stores_have(root, files)) return;
      throw Error(ErrorCode::failed_precondition,
                  damaged + "; \"deformd store rebuild --data-dir " + root.string() +
                      "\" writes it anew, and the catalog from the files, once what is not the store's is moved elsewhere");
    }
    throw Error(ErrorCode::failed_precondition, "store: " + root.string() + " is of another version (\"" +
                                                    text.substr(0, text.find('\n')) + "\"), this server knows \"" +
                                                    std::string(mark_text, std::strlen(mark_text) - 1) + "\"");
  }
  if (accept == StoreDirectory::Accept::existing) {
    std::string message = "store: " + root.string() + " is not a store of deformd (it has no file \"" + mark_name + "\")";
    if (alone && laid_out_like_a_store(root, files)) {
      message += "; it looks like one: \"deformd store rebuild --data-dir " + root.string() + "\" writes the file anew";
    }
    throw Error(ErrorCode::failed_precondition, message);
  }
  if (is_empty_folder(root, files)) return;
  if (alone && is_catalog_of_0_1(root / "catalog.sqlite", files)) return;
  if (alone && accept == StoreDirectory::Accept::also_files && laid_out_like_a_store(root, files)) return;
  throw not_a_store(root, files);
}

enum class Lock { alone, shared };

using std::chrono_literals::operator""ms;

/// A server that was killed holds its lock until the kernel has taken its memory apart: a second for some gigabytes. Who starts
/// the next one at once need not know that.
constexpr std::chrono::milliseconds lock_patience = 3000ms;
constexpr std::chrono::milliseconds lock_pause = 50ms;

int lock(const fs::path& root, Lock how, FileSystem& files) {
  const fs::path file = root / "lock";
  const int descriptor = files.open(file, O_RDWR | O_CREAT | O_NOFOLLOW);
  if (descriptor < 0) fail_on(files, "open", file);
  const auto locks = [&] { return (how == Lock::alone ? files.lock(descriptor) : files.lock_shared(descriptor)) == 0; };
  bool locked = locks();
  for (auto waited = 0ms; !locked && errno == EWOULDBLOCK && waited < lock_patience; waited += lock_pause) {
    if (waited == 0ms)
      spdlog::info("store: {} is in use by another process; waiting for up to {} s", root.string(), lock_patience / 1000ms);
    std::this_thread::sleep_for(lock_pause);
    locked = locks();
  }
  if (!locked) {
    if (how == Lock::shared && errno != EWOULDBLOCK) {
      // The mark keeps servers that want it alone away, too.
      spdlog::warn("store: {} cannot be locked: {}", file.string(), std::strerror(errno));
      return descriptor;
    }
    files.close(descriptor);
    throw Error(ErrorCode::unavailable, "store: the data directory " + root.string() + " is in use by another process");
  }
  return descriptor;
}

void write_mark_text(const fs::path& root, const std::string& text, FileSystem& files) {
  const fs::path part = root / (std::string(mark_name) + ".part");
  {
    const File file(files, part, O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW);
    file.write(text.data(), text.size());
    file.sync();
  }
  move_file(files, part, root / mark_name);
  sync_directory(files, root);
}

}  // namespace

StoreDirectory::StoreDirectory(const fs::path& root, Accept accept, FileSystem& files, const std::string& catalog)
    : files_(files), root_(root), mark_(mark_of(catalog)) {
  try {
    examine(root, accept, mark_, files);
    make_directories(files, root);
    lock_descriptor_ = lock(root, catalog.empty() ? Lock::alone : Lock::shared, files);
    examine(root, accept, mark_, files);  // another process may have been faster
    if (!has_mark(root, files)) {
      // What users register is for nobody else on this machine.
      if (files.close_to_others(root) != 0)
        spdlog::warn("store: cannot close {} to others: {}", root.string(), std::strerror(errno));
      // A catalog of 0.1 is marked and then migrated, its copy made first: without the mark, a migrated one would be nobody's.
      const fs::path copy = this->catalog().string() + ".schema-1";
      if (catalog.empty() && is_catalog_of_0_1(this->catalog(), files) && !exists(files, copy)) {
        try {
          copy_catalog(this->catalog(), copy, files);
        } catch (const Error& error) {
          if (error.code() != ErrorCode::data_loss) throw;  // a damaged one is set aside whole, later
        }
      }
      write_mark_text(root, mark_, files);
      spdlog::info("store: {} is now a store of deformd", root.string());
    } else if (catalog.empty() && content(root / mark_name, files) != mark_text) {
      // The mark of format 2, before the catalog is changed, which an older server would not understand; or damaged.
      write_mark(root, files);
    }
    for (const fs::path& folder : {geometries(), names(), setups(), tmp(), damaged(), unclaimed()}) {
      if (!is_directory(files, folder) && files.make_directory(folder) != 0 && errno != EEXIST) fail_on(files, "create", folder);
    }
    sync_directory(files, root);
  } catch (...) {
    if (lock_descriptor_ >= 0) files.close(lock_descriptor_);
    throw;
  }
}

StoreDirectory::~StoreDirectory() { files_.close(lock_descriptor_); }

bool StoreDirectory::is_reachable() const {
  try {
    return content(root_ / mark_name, files_) == mark_;
  } catch (const Error&) {
    return false;
  }
}

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
    // Not exists(): a link that leads nowhere is something, too. Only this process writes here.
    if (is_anything(files_, to)) continue;
    move_file(files_, file, to);
    sync_directory(files_, shelf);
    sync_directory(files_, file.parent_path());
    return to;
  }
}

bool has_mark(const fs::path& root, FileSystem& files) { return is_file(files, root / mark_name); }

void write_mark(const fs::path& root, FileSystem& files) { write_mark_text(root, mark_text, files); }

bool is_interrupted_copy(const fs::path& folder, FileSystem& files) {
  return !has_mark(folder, files) && is_directory(files, folder / "geometries") && has_only_what_stores_have(folder, files);
}

bool is_empty_folder(const fs::path& folder, FileSystem& files) {
  if (!exists(files, folder)) return true;
  const auto entries = entries_of(files, folder);
  return std::all_of(entries.begin(), entries.end(),
                     [](const fs::path& path) { return is_among(nothing_of_anybody, path.filename()); });
}

fs::path StoreDirectory::set_aside_catalog() const {
  for (int number = 0;; ++number) {
    const fs::path folder = damaged() / ("catalog." + std::to_string(number));
    if (files_.make_directory(folder) != 0) {
      if (errno != EEXIST) fail_on(files_, "create", folder);
      continue;  // an earlier one
    }
    for (const char* suffix : {"", "-wal", "-shm"}) {
      const fs::path file = catalog().string() + suffix;
      if (is_anything(files_, file)) move_file(files_, file, folder / file.filename());
    }
    for (const fs::path& changed : {folder, damaged(), root_}) sync_directory(files_, changed);
    return folder / catalog().filename();
  }
}

std::size_t count_entries(const fs::path& folder, FileSystem& files) {
  std::vector<std::string> names;
  return files.list(folder, names) == 0 ? names.size() : 0;
}

}  // namespace deform::server
