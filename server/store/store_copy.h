// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <sys/stat.h>

#include <filesystem>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>

#include "server/store/file.h"
#include "server/store/file_system.h"

namespace deform::server {

/// A folder that becomes a store of one server, file by file. As long as it is none it has a note that says of what it is a copy,
/// and the copy may be interrupted and begun again: what is there is kept as far as it is the same. One thread.
class StoreCopy {
 public:
  /// Throws Error(failed_precondition) when `to` is neither new nor empty nor what an interrupted copy of the same `source` has
  /// left, and Error(unavailable) while another process copies to it.
  StoreCopy(const std::filesystem::path& to, const std::string& source, FileSystem& files);

  const std::filesystem::path& root() const { return root_; }
  std::filesystem::path catalog() const { return root_ / "catalog.sqlite"; }
  /// The file under this name: a hard link where it can go, else a copy. False when it is gone.
  bool take(const std::filesystem::path& from, const char* folder, const std::string& name);
  /// Removes files of the folder whose names are not among these. All here was made by copies of the same source.
  void drop_others(const char* folder, const std::set<std::string>& names);
  /// Removes the catalog.
  void drop_catalog();
  /// Makes all of it durable, and a store of it.
  void finish();

  /// The folders of a store of one server: the contents, and the records of geometries and setups.
  static constexpr const char* folders[] = {"geometries", "names", "setups"};

 private:
  struct Version {
    dev_t device;
    ino_t file;
    timespec changed;
    bool operator==(const Version& other) const;
  };
  void copy(const std::filesystem::path& from, const std::filesystem::path& to, const struct stat& about);

  const std::filesystem::path root_;
  FileSystem& files_;
  std::unique_ptr<File> note_;  // locked
  /// What bytes that tenants share were copied to: they are copied once and linked again. A server beside may remove files and
  /// give their inodes to others, so that the content must be the same, too.
  std::map<std::pair<dev_t, ino_t>, std::filesystem::path> copies_;
  std::map<std::filesystem::path, Version> taken_;  ///< of copies of this run, what they are of
};

}  // namespace deform::server
