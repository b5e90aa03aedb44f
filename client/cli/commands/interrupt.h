// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <signal.h>

#include <atomic>
#include <thread>

#include "core/base/run_context.h"

namespace deform::cli {

/// Turns Ctrl-C (SIGINT) and SIGTERM into a cancel flag; a second one ends the program at once. Make it before any other thread,
/// so that all inherit the blocked signals; one at a time.
class Interrupt {
 public:
  Interrupt();
  ~Interrupt();
  Interrupt(const Interrupt&) = delete;
  Interrupt& operator=(const Interrupt&) = delete;

  const CancelFlag& flag() const { return flag_; }

 private:
  void wait();

  sigset_t signals_;
  CancelFlag flag_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace deform::cli
