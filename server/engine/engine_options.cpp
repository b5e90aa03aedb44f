#include <string>

#include "server/engine/engine.h"

namespace deform::server {

namespace {

void check_range(const char* option, std::size_t value, std::size_t low, std::size_t high) {
  if (value >= low && value <= high) return;
  throw Error(ErrorCode::invalid_argument, std::string("option ") + option + ": " + std::to_string(value) +
                                               " is out of range, allowed are " + std::to_string(low) + " to " +
                                               std::to_string(high));
}

}  // namespace

void EngineOptions::validate() const {
  if (data_dir.empty()) throw Error(ErrorCode::invalid_argument, "option data_dir: must not be empty");
  if (workers < 0 || workers > 1024) {
    throw Error(ErrorCode::invalid_argument,
                "option workers: " + std::to_string(workers) + " is out of range, allowed are 0 to 1024 (0: one per core)");
  }
  check_range("queue_limit", queue_limit, 1, 1'000'000);
  check_range("max_points", max_points, 1, 4'294'967'295u);
  check_range("max_faces", max_faces, 0, 4'294'967'295u);
  check_range("max_groups", max_groups, 0, 1'000'000);
  check_range("max_designs", max_designs, 1, 1'000'000);
  check_range("max_handles", max_handles, 1, 1'000'000);
  check_range("block_points", block_points, 256, 40'000);
  if (memory_budget != 0 && cache_budget > memory_budget) {
    throw Error(ErrorCode::invalid_argument, "option cache_budget: " + std::to_string(cache_budget) +
                                                 " bytes is more than memory_budget, " + std::to_string(memory_budget) +
                                                 " bytes");
  }
}

}  // namespace deform::server
