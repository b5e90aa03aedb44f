// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "core/base/run_context.h"

namespace deform::io {

/// A program that was started to answer one request. It inherits nothing but its standard input, which is `request`, its standard
/// output, which is read here, and the environment; its standard error goes nowhere, since what a crashing library has to say
/// there helps nobody. For one thread.
class IsolatedProcess {
 public:
  /// Throws Error(failed_precondition) when it cannot be started.
  IsolatedProcess(const std::vector<std::string>& command, int request);
  ~IsolatedProcess() { end(); }
  IsolatedProcess(const IsolatedProcess&) = delete;
  IsolatedProcess& operator=(const IsolatedProcess&) = delete;

  /// At most `size` bytes of its answer; 0 when it ended or closed its output. Throws Error(cancelled).
  std::size_t read(char* to, std::size_t size, const std::optional<CancelFlag>& cancel);

  /// How it ended, as wait() says it; nothing when nobody knows. What still runs is killed.
  std::optional<int> end();

 private:
  pid_t process_ = -1;
  int answer_ = -1;
  std::optional<int> status_;
};

}  // namespace deform::io
