// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <map>
#include <mutex>
#include <string>
#include <utility>

#include "core/deformers/system.h"

namespace deform::server {

/// Where the designs of one stream stand, system by system (System::bind_sequence). Thread-safe; a request takes what the last
/// finished one left.
class WarmStarts {
 public:
  /// Empty when there is none.
  WarmStart last(const std::string& system_id) const {
    const std::lock_guard lock(mutex_);
    const auto found = last_.find(system_id);
    return found == last_.end() ? WarmStart{} : found->second;
  }

  void set(const std::string& system_id, WarmStart warm) {
    const std::lock_guard lock(mutex_);
    if (last_.size() >= most_systems && !last_.contains(system_id)) last_.clear();
    last_.insert_or_assign(system_id, std::move(warm));
  }

  static constexpr std::size_t most_systems = 16;  ///< of a stream, each some 100 kB

 private:
  mutable std::mutex mutex_;
  std::map<std::string, WarmStart> last_;
};

}  // namespace deform::server
