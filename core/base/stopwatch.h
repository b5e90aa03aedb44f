// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>

#include "core/base/run_context.h"

namespace deform {

/// Measures intervals of time.
class Stopwatch {
 public:
  /// Seconds since construction or the last call.
  double lap() {
    const auto now = RunContext::Clock::now();
    const double seconds = std::chrono::duration<double>(now - last_).count();
    last_ = now;
    return seconds;
  }

 private:
  RunContext::Clock::time_point last_ = RunContext::Clock::now();
};

}  // namespace deform
