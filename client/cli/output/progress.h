// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <chrono>
#include <cstddef>
#include <mutex>
#include <string>

namespace deform::cli {

/// One line on stderr that is drawn over and over, at most ten times a second, and wiped at the end. Silent when stderr is not a
/// terminal. Thread-safe.
class Progress {
 public:
  Progress();
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// "factor  [#####.....]  50 %"
  void fraction(const std::string& stage, double done);
  /// "sweep  [#####.....]  50/100  12.3/s  4 s left"; rate and time left from the start of this object.
  void count(const std::string& stage, std::size_t done, std::size_t total);
  void clear();

 private:
  bool due(const std::string& stage, bool last);
  void draw(const std::string& line);

  const bool terminal_;
  const std::chrono::steady_clock::time_point started_ = std::chrono::steady_clock::now();
  std::mutex mutex_;
  // under mutex_
  std::chrono::steady_clock::time_point drawn_{};
  std::string stage_;
  bool visible_ = false;
};

}  // namespace deform::cli
