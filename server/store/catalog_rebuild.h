// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <string>

#include "server/store/catalog.h"
#include "server/store/store_directory.h"

namespace deform::server {

/// What bringing catalog and files together has found and done.
struct RebuildReport {
  std::string set_aside;               ///< where a damaged catalog is kept now; empty: there was none
  std::size_t adopted_geometries = 0;  ///< entered into the catalog because their files were there
  std::size_t adopted_setups = 0;
  std::size_t mended = 0;         ///< damaged entries of the catalog made whole
  std::size_t still_damaged = 0;  ///< damaged entries of which nothing else is known
  std::size_t recorded = 0;       ///< small files written for entries that had none
  std::size_t garbage = 0;        ///< files removed that an intent names
  std::size_t unclaimed = 0;      ///< files moved to unclaimed/
  std::size_t damaged = 0;        ///< files moved to damaged/
  std::size_t missing = 0;        ///< geometries of the catalog without a file
  bool full = false;              ///< the disk had no room for all of that; the next start goes on
};

enum class OldCatalog { keep_if_whole, set_aside };

struct OpenedCatalog {
  std::unique_ptr<Catalog> catalog;
  RebuildReport report;
};

/// Opens the catalog of a store and brings it and the files together; see geometry_store.h. A catalog that is damaged is set
/// aside, and a new one made of the files and of what can still be read of it. Only files without an entry are read whole, so
/// that the start of a healthy store is fast. What was found is logged. Errors: as a Catalog and a File.
OpenedCatalog open_catalog(const StoreDirectory& directory, OldCatalog old);

enum class RemoveFiles {
  all,         ///< that the intent names
  not_renewed  ///< those that were not put again since
};

/// Does what an intent to remove says and ends it; returns the number of files removed. Calls step(what) after each.
std::size_t finish_removal(const StoreDirectory& directory, Catalog& catalog, const Intent& intent, RemoveFiles which,
                           const std::function<void(const char*)>& step);

}  // namespace deform::server
