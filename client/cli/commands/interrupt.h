// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <signal.h>

#include <atomic>
#include <stop_token>
#include <thread>

namespace deform::cli {

/// Turns Ctrl-C (SIGINT) and SIGTERM into a request to stop; a second one ends the program at once. Make it before any other
/// thread, so that all inherit the blocked signals; one at a time. What a stop calls back runs on its thread, not in a signal
/// handler.
class Interrupt {
 public:
  Interrupt();
  ~Interrupt();
  Interrupt(const Interrupt&) = delete;
  Interrupt& operator=(const Interrupt&) = delete;

  std::stop_token token() const { return stop_.get_token(); }

 private:
  void wait();

  sigset_t signals_;
  std::stop_source stop_;
  std::atomic<bool> ended_{false};
  std::thread thread_;
};

}  // namespace deform::cli
