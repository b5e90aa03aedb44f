// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>

#include "server/store/file_system.h"

namespace deform::server {

/// Where the files of a store are (see geometry_store.h, shared_store.h), and the right to use them: the folder is locked against
/// other processes while the object lives, that of a shared store only against those that want it alone. Functions that move
/// files are for one thread at a time.
class StoreDirectory {
 public:
  enum class Accept {
    stores,      ///< stores, empty folders, and stores of 0.1 by their catalog
    also_files,  ///< what is laid out like a store, too, without mark or catalog, or with a damaged mark: for rebuilding it by
                 ///< hand
    existing     ///< only what has the mark
  };

  /// Makes the folder when it is missing or empty, marks it, and makes the folders inside. Throws Error(failed_precondition) for
  /// a folder of something else, which stays as it is, and for stores of later versions; Error(unavailable) when another process
  /// has the store and does not give it up within 3 s, or it cannot be written. `catalog`: the identity of the SharedCatalog that
  /// says what is in it; empty for a store that has its own. Each refuses the folders of the other.
  StoreDirectory(const std::filesystem::path& root, Accept accept, FileSystem& files, const std::string& catalog = {});
  ~StoreDirectory();
  StoreDirectory(const StoreDirectory&) = delete;
  StoreDirectory& operator=(const StoreDirectory&) = delete;

  FileSystem& files() const { return files_; }
  const std::filesystem::path& root() const { return root_; }
  /// Whether the folder is there and still this store: not that below the place where a share was mounted.
  bool is_reachable() const;
  std::filesystem::path catalog() const { return root_ / "catalog.sqlite"; }
  std::filesystem::path reserve() const { return root_ / "reserve"; }
  std::filesystem::path geometries() const { return root_ / "geometries"; }
  std::filesystem::path names() const { return root_ / "names"; }
  std::filesystem::path setups() const { return root_ / "setups"; }
  /// Not made with the others, but by who writes there first.
  std::filesystem::path bases() const { return root_ / "bases"; }
  std::filesystem::path tmp() const { return root_ / "tmp"; }
  std::filesystem::path damaged() const { return root_ / "damaged"; }
  std::filesystem::path unclaimed() const { return root_ / "unclaimed"; }

  /// In tmp/, of the intent with that number and the key of its entry: the content of a geometry, a further link to it, and the
  /// record of a geometry or setup.
  std::filesystem::path temporary(const std::string& key, std::int64_t intent) const;
  std::filesystem::path temporary_link(const std::string& key, std::int64_t intent) const;
  std::filesystem::path temporary_record(const std::string& key, std::int64_t intent) const;

  /// Puts files aside for good, under a name that nothing has yet; returns the new path. `shelf` is damaged() or unclaimed().
  std::filesystem::path set_aside(const std::filesystem::path& file, const std::filesystem::path& shelf) const;
  /// Puts the catalog and its log into a folder of their own in damaged(); returns the new path of the catalog.
  std::filesystem::path set_aside_catalog() const;

 private:
  FileSystem& files_;
  std::filesystem::path root_;
  const std::string mark_;
  int lock_descriptor_ = -1;
};

/// The mark of a store: the file "deformd-store" and its one line. write_mark throws as a File does.
bool has_mark(const std::filesystem::path& root, FileSystem& files = system_files());
void write_mark(const std::filesystem::path& root, FileSystem& files = system_files());

/// In a folder that is being made a copy of a store (store_copy.h).
inline constexpr const char* unfinished_copy_name = "deformd-unfinished-copy";

/// What a backup or restore leaves that was interrupted: it writes the mark last.
bool is_interrupted_copy(const std::filesystem::path& folder, FileSystem& files);

/// Nothing in it but what file systems put there themselves; also when it does not exist.
bool is_empty_folder(const std::filesystem::path& folder, FileSystem& files);

/// Number of entries; 0 when there is no such folder.
std::size_t count_entries(const std::filesystem::path& folder, FileSystem& files = system_files());

}  // namespace deform::server
