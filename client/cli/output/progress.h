// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <mutex>
#include <string>
#include <thread>

namespace deform::cli {

/// What a command is doing, on stderr. On a terminal it is one line that is drawn over and over, at most ten times a second, and
/// wiped at the end; elsewhere, as in a pipe or a log, a line every ten seconds, "deform: progress: sweep  3/40", so that short
/// commands have none. Thread-safe.
class Progress {
 public:
  /// `every`: between two lines where stderr is no terminal.
  explicit Progress(std::chrono::milliseconds every = std::chrono::seconds(10));
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// "factor  [#####.....]  50 %"
  void fraction(const std::string& stage, double done);
  /// "sweep  [#####.....]  50/100  12.3/s  4 s left"; rate and time left from the start of this object.
  void count(const std::string& stage, std::size_t done, std::size_t total);
  /// "split  20 s", until something else is shown or clear() is called: of what does not tell how far it is.
  void wait(const std::string& stage);
  void clear();

 private:
  void show(const std::string& stage, const std::string& bar, const std::string& text, bool last);
  void draw(const std::string& line);
  void tick(const std::stop_token& stop);

  const bool terminal_;
  const std::chrono::milliseconds every_;
  const std::chrono::steady_clock::time_point started_ = std::chrono::steady_clock::now();
  std::mutex mutex_;
  std::condition_variable_any changed_;
  // under mutex_
  std::chrono::steady_clock::time_point drawn_{}, waiting_since_{};
  std::string stage_, text_;
  bool visible_ = false, waiting_ = false;

  std::jthread ticker_;  ///< from the first wait(), or where there is no terminal from the first of anything
};

}  // namespace deform::cli
