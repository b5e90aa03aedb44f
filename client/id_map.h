// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

namespace deform::client {

/// Something small by id. Thread-safe.
template <typename Value>
class IdMap {
 public:
  /// In place of what was there.
  void keep(const std::string& id, Value value) {
    const std::lock_guard lock(mutex_);
    entries_.insert_or_assign(id, std::move(value));
  }
  /// Nothing where there is none.
  std::optional<Value> get(const std::string& id) const {
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(id);
    return found == entries_.end() ? std::nullopt : std::optional<Value>(found->second);
  }
  /// All of another map, which must not be this one.
  void keep_all(const IdMap& from) {
    const std::scoped_lock lock(mutex_, from.mutex_);
    for (const auto& [id, value] : from.entries_) entries_.insert_or_assign(id, value);
  }
  /// All of which drop(id, value) says so.
  template <typename Drop>
  void forget_if(const Drop& drop) {
    const std::lock_guard lock(mutex_);
    std::erase_if(entries_, [&](const auto& entry) { return drop(entry.first, entry.second); });
  }

 private:
  mutable std::mutex mutex_;
  std::map<std::string, Value> entries_;  // under mutex_
};

}  // namespace deform::client
