// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <memory>

#include "server/store/catalog.h"
#include "server/store/file_system.h"

namespace deform::server {

/// A catalog in one SQLite file (write-ahead log, fully synchronous). One server at a time; the caller sees to that. Made when it
/// is not there. A catalog of deformd 0.1 is migrated in one transaction, after a copy of it ("<file>.schema-1"). Throws
/// Error(unavailable) when the file cannot be opened, Error(out_of_budget) when there is no room for its log, and
/// Error(data_loss) when it is not such a catalog.
std::unique_ptr<Catalog> open_sqlite_catalog(const std::filesystem::path& file, FileSystem& files = system_files());

}  // namespace deform::server
