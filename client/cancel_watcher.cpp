// SPDX-License-Identifier: Apache-2.0
#include "client/cancel_watcher.h"

#include <chrono>
#include <utility>

namespace deform::client {

CancelWatcher::~CancelWatcher() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
}

std::uint64_t CancelWatcher::watch(const CancelFlag& flag, std::function<void()> action) {
  const std::lock_guard lock(mutex_);
  watched_.emplace(++last_token_, Watched{flag, std::move(action)});
  if (!thread_.joinable()) thread_ = std::thread([this] { run(); });
  changed_.notify_all();
  return last_token_;
}

void CancelWatcher::unwatch(std::uint64_t token) {
  const std::lock_guard lock(mutex_);
  watched_.erase(token);
}

void CancelWatcher::run() {
  constexpr std::chrono::milliseconds period{5};
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    if (watched_.empty()) {
      changed_.wait(lock);
      continue;
    }
    for (auto it = watched_.begin(); it != watched_.end();) {
      if (!it->second.flag.cancelled()) {
        ++it;
        continue;
      }
      it->second.action();
      it = watched_.erase(it);
    }
    changed_.wait_for(lock, period, [this] { return stopping_; });
  }
}

}  // namespace deform::client
