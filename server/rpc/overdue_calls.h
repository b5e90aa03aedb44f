// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <grpcpp/server_context.h>

#include <chrono>
#include <condition_variable>
#include <map>
#include <mutex>
#include <thread>
#include <utility>

#include "core/base/error.h"

namespace deform::server {

/// Ends calls that go on beyond a time of the server's own: an upload that never ends, a reader that never reads. Their clients
/// learn why even where messages wait for them, which a status that is finished with comes after. Work in the engine ends by
/// its deadline before. Thread-safe.
class OverdueCalls {
 public:
  using Clock = std::chrono::steady_clock;

  OverdueCalls() = default;
  ~OverdueCalls();
  OverdueCalls(const OverdueCalls&) = delete;
  OverdueCalls& operator=(const OverdueCalls&) = delete;

  /// Until forget(), the context must live.
  void watch(grpc::CallbackServerContext* context, Clock::time_point limit, Error why);
  /// When it returns, the context is not touched any more.
  void forget(grpc::CallbackServerContext* context, Clock::time_point limit);

 private:
  using Entry = std::pair<Clock::time_point, grpc::CallbackServerContext*>;
  void run();

  std::mutex mutex_;
  // under mutex_
  std::condition_variable changed_;
  std::map<Entry, Error> calls_;
  grpc::CallbackServerContext* cancelling_ = nullptr;
  bool stopping_ = false;
  std::thread thread_;  ///< starts with the first call
};

}  // namespace deform::server
