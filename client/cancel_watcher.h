// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <mutex>
#include <thread>

#include "core/base/run_context.h"

namespace deform::client {

/// Carries cancel flags, which are only polled, to calls that block: one thread looks at all watched flags every few milliseconds
/// while there are any. Thread-safe.
class CancelWatcher {
 public:
  CancelWatcher() = default;
  ~CancelWatcher();
  CancelWatcher(const CancelWatcher&) = delete;
  CancelWatcher& operator=(const CancelWatcher&) = delete;

  /// Calls `action` once, on the watcher's thread, when the flag is set before unwatch(). `action` must not block nor call back.
  std::uint64_t watch(const CancelFlag& flag, std::function<void()> action);
  /// After it the action is not running and will not run.
  void unwatch(std::uint64_t token);

 private:
  struct Watched {
    CancelFlag flag;
    std::function<void()> action;
  };
  void run();

  std::mutex mutex_;
  // under mutex_
  std::condition_variable changed_;
  std::map<std::uint64_t, Watched> watched_;
  std::uint64_t last_token_ = 0;
  bool stopping_ = false;
  std::thread thread_;
};

}  // namespace deform::client
