// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "server/store/basis_files.h"
#include "server/store/catalog.h"
#include "server/store/file_system.h"
#include "server/store/store_directory.h"

namespace deform::server {

/// What an operator does to a store by hand; see geometry_store.h for what is where. Errors: as opening a GeometryStore.

/// What a command found and did, in lines to be printed.
struct StoreReport {
  enum class Outcome { well, faults };
  Outcome outcome = Outcome::well;
  std::vector<std::string> lines;
};

/// A line about a fault.
void complain(StoreReport& report, const std::string& line);
/// "geometry ID of tenant NAME"; without the tenant when that is the default one.
std::string named(const char* what, const OwnedId& id);

/// Reads and verifies every file of a store that no server has open; changes nothing.
StoreReport check_store(const std::filesystem::path& data_dir, FileSystem& files = system_files());

/// The same of a store that is open and in use; files without an entry are not looked for, since some are always on their way.
/// `room` is held while a geometry is in memory. Throws the errors of `room` and of the context.
using RoomFor = std::function<std::shared_ptr<void>(const GeometryRecord& geometry)>;
StoreReport check_open_store(const StoreDirectory& directory, Catalog& catalog, const BasisFiles& bases,
                             const RunContext& context, const RoomFor& room);
/// Reads and verifies the files of bases/: a line for each that is damaged, and how many there are, if any.
void check_bases(StoreReport& report, const BasisFiles& bases, const RunContext& context);

/// Sets the catalog aside and makes a new one of the files; also of a folder that lost its mark. Needs a stopped server.
StoreReport rebuild_store(const std::filesystem::path& data_dir, FileSystem& files = system_files());

/// Makes `to`, a new or empty folder, a store of the same content, beside a server that may run: a consistent copy of the
/// catalog, and hard links of the files, which never change; copies where links cannot go. The result is complete when it has its
/// mark. `to` may also be what the same command has left when it was interrupted: it goes on there.
StoreReport backup_store(const std::filesystem::path& data_dir, const std::filesystem::path& to,
                         FileSystem& files = system_files());

/// The same in the other direction; refuses a data directory that is not empty.
StoreReport restore_store(const std::filesystem::path& from, const std::filesystem::path& data_dir,
                          FileSystem& files = system_files());

}  // namespace deform::server
