#pragma once

#include <filesystem>
#include <memory>

#include "server/catalog.h"

namespace deform::server {

/// A catalog in one SQLite file (write-ahead log, fully synchronous). One process at a time; the caller sees to that.
/// Throws Error(unavailable) when the file cannot be opened and Error(data_loss) when it is not such a catalog.
std::unique_ptr<Catalog> open_sqlite_catalog(const std::filesystem::path& file);

}  // namespace deform::server
