// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>

#include "server/store/file_system.h"
#include "server/store/shared_catalog.h"
#include "server/store/shared_store.h"
#include "server/store/store_commands.h"

namespace deform::server {

/// Between the store of several servers and that of one, which is what a backup of either is. All beside servers that run; all
/// can be interrupted and begun again, and goes on then.

/// Makes `to` a store of one server with all that was in the catalog in one moment: hard links of the files, copies where those
/// cannot go. Throws as backup_store(), and Error(unavailable) where the database cannot be reached.
StoreReport backup_shared_store(SharedCatalog& catalog, const StoreDirectory& directory, const std::filesystem::path& to);

/// Adds what the store of one server has, for the same tenants and with its names and times, and reads all of it back. What is
/// there already stays as it is, and so does `from`, which no server may have open. What is damaged is left out and named.
StoreReport import_store(const std::filesystem::path& from, SharedStore& store, FileSystem& files = system_files());

/// The same into a store that has nothing yet. Throws Error(failed_precondition) when it has.
StoreReport restore_shared_store(const std::filesystem::path& from, SharedStore& store, FileSystem& files = system_files());

}  // namespace deform::server
