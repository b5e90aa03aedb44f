// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <vector>

#include "server/store/catalog.h"
#include "server/store/file_system.h"

namespace deform::server {

/// What is done to the file of an SQLite catalog as a whole. Errors: as a Catalog.

/// Does the file hold, as its text, the tables that deformd 0.1 makes? Only reads, so that a folder of something else stays as it
/// is.
bool is_catalog_of_0_1(const std::filesystem::path& file, FileSystem& files);

/// A consistent copy in a new file, also of a catalog that a server has open. `to` appears when it is complete.
void copy_catalog(const std::filesystem::path& from, const std::filesystem::path& to, FileSystem& files);

/// What can still be read of a damaged catalog, of any version: whole records only. The file is not changed. Never throws.
struct Salvaged {
  std::vector<GeometryRecord> geometries;
  std::vector<SetupRecord> setups;
  std::vector<Intent> intents;
};
Salvaged salvage_catalog(const std::filesystem::path& file, FileSystem& files = system_files());

/// The record of a geometry says what it is about; that of a setup has an id that is the hash of the setup. For records of 0.1,
/// which have no checksums.
bool is_plausible(const GeometryRecord& record);
bool is_plausible(const SetupRecord& record);

}  // namespace deform::server
