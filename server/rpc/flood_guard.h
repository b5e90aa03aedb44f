// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <chrono>
#include <functional>
#include <mutex>
#include <string>
#include <unordered_map>

namespace deform::server {

/// Notices connections that begin calls and reset them faster than anyone could want: calls that are reset do not count against
/// --max-calls-per-connection, and each costs this process more than it costs its client. Thread-safe.
class FloodGuard {
 public:
  static constexpr int most_resets = 1000;  ///< within a second

  /// What happens to such a connection; called once per flood, by any thread. Set before the first call.
  void on_flood(std::function<void(const std::string& peer)> action) { action_ = std::move(action); }
  /// A call of this connection was reset by its client.
  void note_reset(const std::string& peer);

 private:
  using Clock = std::chrono::steady_clock;
  std::function<void(const std::string&)> action_;
  std::mutex mutex_;
  // under mutex_: of the second that began then
  std::unordered_map<std::string, int> resets_;
  Clock::time_point began_{};
};

}  // namespace deform::server
