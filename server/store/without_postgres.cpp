// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/base/error.h"
#include "server/store/postgres_catalog.h"

namespace deform::server {

void check_catalog_uri(const std::string&) {
  throw Error(ErrorCode::invalid_argument,
              "this deformd was built without PostgreSQL: install libpq-dev and build it with -DDEFORM_WITH_POSTGRES=ON");
}

std::unique_ptr<SharedCatalog> open_postgres_catalog(const PostgresOptions& options) {
  check_catalog_uri(options.uri);
  return nullptr;
}

}  // namespace deform::server
