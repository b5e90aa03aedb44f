// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <optional>
#include <stop_token>
#include <string>

namespace deform {

/// Cancellation, deadline, progress, and limits of memory and threads of a call, passed down the call chain by const reference. A
/// default-constructed context cannot be cancelled, has no deadline, reports no progress and may use all memory and cores. Any
/// number of threads may call check() and progress().
class RunContext {
 public:
  /// The clock of deadlines. It is monotonic.
  using Clock = std::chrono::steady_clock;
  /// Receives the name of a stage ("assemble", "factor", "basis", ...) and the fraction of it that is done, 0..1.
  using Progress = std::function<void(const std::string& stage, double fraction)>;
  /// Receives a number of bytes that the work is about to keep until it ends. Throws Error(out_of_budget) to stop it.
  using Claim = std::function<void(std::size_t bytes)>;

  RunContext() = default;

  std::stop_token stop;                       ///< stops the work with Error(cancelled)
  std::optional<Clock::time_point> deadline;  ///< stops the work with Error(deadline_exceeded)
  Progress on_progress;                       ///< must be callable from any thread; may be empty
  Claim on_claim;                             ///< for memory that no estimate contains; called from one thread; may be empty
  int threads = 0;                            ///< upper limit of threads for this call; 0 = all cores

  /// Throws Error(cancelled) or Error(deadline_exceeded) if the work must stop. Cheap; call it once per block of work.
  void check() const;

  /// Reports progress to on_progress, if there is one.
  void progress(const std::string& stage, double fraction) const {
    if (on_progress) on_progress(stage, fraction);
  }

  /// Tells on_claim, if there is one.
  void claim(std::size_t bytes) const {
    if (on_claim) on_claim(bytes);
  }
};

}  // namespace deform
