// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <chrono>
#include <memory>
#include <string>

#include "server/store/shared_catalog.h"

namespace deform::server {

struct PostgresOptions {
  std::string uri;  ///< postgresql://..., without a password
  /// How long opening waits for a database that does not answer yet.
  std::chrono::milliseconds start_patience{30'000};
  /// How long a call waits for one that does not answer any more.
  std::chrono::milliseconds call_patience{2'000};
  /// The same for what is stored after long work.
  std::chrono::milliseconds setup_patience{30'000};
  /// Sessions that had ended twice in such a distance are taken over.
  std::chrono::milliseconds take_over_after{30'000};
};

/// A catalog in a database of PostgreSQL, in tables of a schema "deformd" of its own, which is made when it is not there. Its
/// sessions hold advisory locks and listen, so that a pooler in between must pool sessions, not transactions. Throws
/// Error(unavailable) when the database cannot be reached, Error(failed_precondition) for tables of a later version, and
/// Error(invalid_argument) as check_catalog_uri().
std::unique_ptr<SharedCatalog> open_postgres_catalog(const PostgresOptions& options);

/// Throws Error(invalid_argument) for what is no URI of PostgreSQL, for one with a password, and where deformd was built without
/// PostgreSQL.
void check_catalog_uri(const std::string& uri);

}  // namespace deform::server
