// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>

namespace deform {

/// Set once, from any thread; long loops see it at their next check. Copies share the flag.
class CancelFlag {
 public:
  CancelFlag() : flag_(std::make_shared<std::atomic<bool>>(false)) {}
  /// Sets the flag for good.
  void cancel() const { flag_->store(true, std::memory_order_relaxed); }
  /// Whether it was set.
  bool cancelled() const { return flag_->load(std::memory_order_relaxed); }

 private:
  std::shared_ptr<std::atomic<bool>> flag_;
};

/// What a call may use and how it is cancelled: handed down the call chain by const reference. A default-constructed context
/// is uncancellable, has no deadline, reports no progress and may use all cores. Any number of threads may call check() and
/// progress().
class RunContext {
 public:
  /// Of deadlines; does not jump when the time of day is set.
  using Clock = std::chrono::steady_clock;
  /// stage name ("assemble", "factor", "basis", ...) and the fraction of it that is done, 0..1
  using Progress = std::function<void(const std::string& stage, double fraction)>;

  RunContext() = default;

  std::optional<CancelFlag> cancel;           ///< stops the work with Error(cancelled)
  std::optional<Clock::time_point> deadline;  ///< stops the work with Error(deadline_exceeded)
  Progress on_progress;                       ///< must be callable from any thread; may be empty
  int threads = 0;                            ///< upper limit of threads for this call; 0 = all cores

  /// Throws Error(cancelled) or Error(deadline_exceeded) when it is time to stop. Cheap: call once per block of work.
  void check() const;

  /// Reports progress to on_progress, if there is one.
  void progress(const std::string& stage, double fraction) const {
    if (on_progress) on_progress(stage, fraction);
  }
};

}  // namespace deform
