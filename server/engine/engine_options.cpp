// SPDX-License-Identifier: GPL-3.0-or-later
#include <string>

#include "core/base/checks.h"
#include "server/engine/engine.h"
#include "server/store/postgres_catalog.h"

namespace deform::server {

void EngineOptions::validate() const {
  if (data_dir.empty()) throw Error(ErrorCode::invalid_argument, "option data_dir: must not be empty");
  if (!catalog.empty()) {
    try {
      check_catalog_uri(catalog);
    } catch (const Error& error) {
      throw Error(error.code(), std::string("option catalog: ") + error.what());
    }
  }
  if (workers < 0 || workers > 1024) {
    throw Error(ErrorCode::invalid_argument,
                "option workers: " + std::to_string(workers) + " is out of range, allowed are 0 to 1024 (0: one per core)");
  }
  check_range(queue_limit, 1, 1'000'000, "option queue_limit");
  check_range(max_points, 1, 4'294'967'295u, "option max_points");
  check_range(max_faces, 0, 4'294'967'295u, "option max_faces");
  check_range(max_groups, 0, 1'000'000, "option max_groups");
  check_range(max_designs, 1, 1'000'000, "option max_designs");
  check_range(max_handles, 1, 1'000'000, "option max_handles");
  check_range(max_setup_work, 1, 1'000'000'000'000'000'000, "option max_setup_work");
  check_range(block_points, 256, 40'000, "option block_points");
  if (memory_budget != 0 && cache_budget > memory_budget) {
    throw Error(ErrorCode::invalid_argument, "option cache_budget: " + std::to_string(cache_budget) +
                                                 " bytes is more than memory_budget, " + std::to_string(memory_budget) +
                                                 " bytes");
  }
}

std::size_t check_cotangent_count(const v1::VectorJacobianHeader& header) {
  if (header.cotangents() > most_cotangents) {
    throw Error(ErrorCode::invalid_argument, "cotangents: " + std::to_string(header.cotangents()) +
                                                 " are more than the limit of " + std::to_string(most_cotangents));
  }
  return std::max<std::size_t>(1, header.cotangents());
}

}  // namespace deform::server
