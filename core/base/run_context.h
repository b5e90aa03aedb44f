// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>

namespace deform {

/// A flag that any thread may set once and that long loops read at their next check. Copies share the flag.
class CancelFlag {
 public:
  CancelFlag() : flag_(std::make_shared<std::atomic<bool>>(false)) {}
  /// Sets the flag; it cannot be reset.
  void cancel() const { flag_->store(true, std::memory_order_relaxed); }
  /// Whether the flag is set.
  bool cancelled() const { return flag_->load(std::memory_order_relaxed); }

 private:
  std::shared_ptr<std::atomic<bool>> flag_;
};

/// Cancellation, deadline, progress and thread limit of a call, passed down the call chain by const reference. A
/// default-constructed context cannot be cancelled, has no deadline, reports no progress and may use all cores. Any number of
/// threads may call check() and progress().
class RunContext {
 public:
  /// The clock of deadlines. It is monotonic.
  using Clock = std::chrono::steady_clock;
  /// Receives the name of a stage ("assemble", "factor", "basis", ...) and the fraction of it that is done, 0..1.
  using Progress = std::function<void(const std::string& stage, double fraction)>;

  RunContext() = default;

  std::optional<CancelFlag> cancel;           ///< stops the work with Error(cancelled)
  std::optional<Clock::time_point> deadline;  ///< stops the work with Error(deadline_exceeded)
  Progress on_progress;                       ///< must be callable from any thread; may be empty
  int threads = 0;                            ///< upper limit of threads for this call; 0 = all cores

  /// Throws Error(cancelled) or Error(deadline_exceeded) if the work must stop. Cheap; call it once per block of work.
  void check() const;

  /// Reports progress to on_progress, if there is one.
  void progress(const std::string& stage, double fraction) const {
    if (on_progress) on_progress(stage, fraction);
  }
};

}  // namespace deform
