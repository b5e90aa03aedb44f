// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <future>
#include <map>
#include <memory>
#include <mutex>
#include <string>

#include "core/base/run_context.h"
#include "core/base/types.h"

namespace deform::client {

/// Registered points by geometry id: fetched once, while others that ask for the same wait. Thread-safe.
class PointsCache {
 public:
  /// Shared by all that use them.
  using PointsPtr = std::shared_ptr<const Points>;

  /// `fetch` runs without a lock; its failure reaches all that wait and is not kept.
  PointsPtr get(const std::string& geometry_id, const RunContext& limits, const std::function<PointsPtr()>& fetch);
  /// Enters points that are in memory anyway.
  void keep(const std::string& geometry_id, PointsPtr points);
  /// All of another cache, which must not be this one.
  void keep_all(const PointsCache& from);
  /// Whether the points are there, or on their way.
  bool has(const std::string& geometry_id) const;
  /// Lets go of the points of a geometry that was deleted.
  void forget(const std::string& geometry_id);

 private:
  mutable std::mutex mutex_;
  std::map<std::string, std::shared_future<PointsPtr>> entries_;  // under mutex_
};

}  // namespace deform::client
