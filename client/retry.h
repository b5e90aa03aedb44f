// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>

#include "core/base/error.h"
#include "core/base/run_context.h"

namespace deform::client {

/// Which errors of a call allow another attempt.
enum class Retry {
  safe,         ///< the call can be repeated at will: lost connections and refusals with a hint
  when_refused  ///< repeating a call that was carried out would be wrong: refusals with a hint, and no connection at all
};

/// Whether an attempt that failed may be followed by another one, as far as the caller is concerned.
enum class Repeat {
  no,     ///< part of its result is in use
  yes,    ///< nothing came of it
  afresh  ///< some of its result came, and only the rest is asked for: attempts count from here
};

/// Decides about another attempt and waits for it: exponential with jitter for lost connections (100 ms, 200 ms, ... 6.4 s, each
/// times 0.5 to 1.5), the server's own hint (times 1 to 1.5) for refusals. Same seed, same waiting times. One thread.
class RetryPolicy {
 public:
  /// How often, and after which errors.
  struct Options {
    int max_attempts = 4;       ///< the first one included
    std::uint64_t seed = 1;     ///< of the jitter
    Retry retry = Retry::safe;  ///< which errors allow another attempt
    /// From the first failure on attempts go on for so long, however many there were: connections are lost while a server
    /// restarts, and many clients that share a rate or a queue are refused often, since each hint is about the next free place
    /// alone.
    std::chrono::milliseconds patience{0};
  };
  /// For one call.
  explicit RetryPolicy(const Options& options) : options_(options), random_(options.seed) {}

  /// How long to wait before the next attempt, or nothing when there shall be none.
  std::optional<std::chrono::milliseconds> next_wait(const Error& error);

  /// The attempts count from here.
  void start_afresh() {
    failed_attempts_ = 0;
    first_failure_.reset();
  }

  /// Waits; a stop or the deadline of the context ends it by its Error.
  static void wait(std::chrono::milliseconds duration, const RunContext& context);

 private:
  double random();  ///< [0, 1)

  const Options options_;
  std::uint64_t random_;
  int failed_attempts_ = 0;
  std::optional<RunContext::Clock::time_point> first_failure_;
};

}  // namespace deform::client
