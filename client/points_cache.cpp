// SPDX-License-Identifier: Apache-2.0
#include "client/points_cache.h"

#include <chrono>
#include <utility>

namespace deform::client {

PointsCache::PointsPtr PointsCache::get(const std::string& geometry_id, const RunContext& limits,
                                        const std::function<PointsPtr()>& fetch) {
  std::promise<PointsPtr> promise;
  std::shared_future<PointsPtr> entry;
  bool mine = false;
  {
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(geometry_id);
    mine = found == entries_.end();
    entry = mine ? promise.get_future().share() : found->second;
    if (mine) entries_.emplace(geometry_id, entry);
  }
  if (!mine) {
    while (entry.wait_for(std::chrono::milliseconds(5)) != std::future_status::ready) limits.check();
    return entry.get();
  }
  try {
    promise.set_value(fetch());
  } catch (...) {
    forget(geometry_id);
    promise.set_exception(std::current_exception());
  }
  return entry.get();
}

void PointsCache::keep(const std::string& geometry_id, PointsPtr points) {
  std::promise<PointsPtr> promise;
  promise.set_value(std::move(points));
  const std::lock_guard lock(mutex_);
  entries_.insert_or_assign(geometry_id, promise.get_future().share());
}

void PointsCache::keep_all(const PointsCache& from) {
  const std::scoped_lock lock(mutex_, from.mutex_);
  for (const auto& [id, points] : from.entries_) entries_.insert_or_assign(id, points);
}

bool PointsCache::has(const std::string& geometry_id) const {
  const std::lock_guard lock(mutex_);
  return entries_.contains(geometry_id);
}

void PointsCache::forget(const std::string& geometry_id) {
  const std::lock_guard lock(mutex_);
  entries_.erase(geometry_id);
}

}  // namespace deform::client
