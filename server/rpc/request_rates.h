// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>

namespace deform::server {

/// How many requests each tenant begins in a second: a bucket of as many tokens as a second gives, filled steadily, so that a
/// tenant that was idle may begin those of one second at once. Only tenants with a limit are kept, which a file names.
/// Thread-safe.
class RequestRates {
 public:
  using Clock = std::chrono::steady_clock;

  /// Takes a token. Throws Error(out_of_budget) with the time until there is one as its retry hint. `per_second` 0: no limit.
  void take(const std::string& tenant, std::uint64_t per_second, Clock::time_point now = Clock::now());

 private:
  struct Bucket {
    double tokens = 0;
    Clock::time_point filled;
  };
  std::mutex mutex_;
  std::map<std::string, Bucket> buckets_;  // under mutex_
};

}  // namespace deform::server
