// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

namespace deform::io {

/// A program started to answer one request. It inherits only its standard input, which is `request`, its standard output, which
/// is read here, and the environment; its standard error is discarded, because messages of a crashing library are of no use.
/// Not thread-safe.
class IsolatedProcess {
 public:
  /// Throws Error(failed_precondition) if the program cannot be started.
  IsolatedProcess(const std::vector<std::string>& command, int request);
  ~IsolatedProcess() { end(); }
  IsolatedProcess(const IsolatedProcess&) = delete;
  IsolatedProcess& operator=(const IsolatedProcess&) = delete;

  /// Reads at most `size` bytes of its answer; returns 0 if it has ended or closed its output. Throws Error(cancelled).
  std::size_t read(char* to, std::size_t size, const std::stop_token& stop);

  /// The status of wait(), or std::nullopt if it is unknown. Kills the process if it is still running.
  std::optional<int> end();

 private:
  pid_t process_ = -1;
  int answer_ = -1;
  std::optional<int> status_;
};

}  // namespace deform::io
