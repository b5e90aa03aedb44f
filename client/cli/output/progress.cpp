// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/output/progress.h"

#include <unistd.h>

#include <algorithm>
#include <cstdio>

#include "client/cli/output/format.h"
#include "core/base/text.h"

namespace deform::cli {

namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds redrawn{100}, seconds_redrawn{1000};

std::string bar(double done) {
  constexpr int width = 30;
  const int filled = static_cast<int>(std::clamp(done, 0.0, 1.0) * width);
  std::string text(width + 2, '.');
  std::fill_n(text.begin() + 1, filled, '#');
  text.front() = '[';
  text.back() = ']';
  return text + "  ";
}

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

}  // namespace

Progress::Progress(std::chrono::milliseconds every) : terminal_(isatty(STDERR_FILENO) == 1), every_(every) {}

Progress::~Progress() { clear(); }

void Progress::fraction(const std::string& stage, double done) {
  char percent[16];
  std::snprintf(percent, sizeof(percent), "%3.0f %%", 100 * std::clamp(done, 0.0, 1.0));
  show(stage, bar(done), percent, done >= 1);
}

void Progress::count(const std::string& stage, std::size_t done, std::size_t total) {
  if (total == 0) return;
  const double seconds = seconds_since(started_);
  std::string text = std::to_string(done) + "/" + std::to_string(total);
  if (done > 0 && seconds > 0) {
    const double rate = static_cast<double>(done) / seconds;
    char more[96];
    std::snprintf(more, sizeof(more), "  %.3g/s  %s left", rate, duration_text(static_cast<double>(total - done) / rate).c_str());
    text += more;
  }
  show(stage, bar(static_cast<double>(done) / static_cast<double>(total)), text, done == total);
}

void Progress::wait(const std::string& stage) {
  const std::lock_guard lock(mutex_);
  stage_ = stage;
  text_.clear();
  waiting_ = true;
  waiting_since_ = Clock::now();
  if (!ticker_.joinable()) ticker_ = std::jthread([this](const std::stop_token& stop) { tick(stop); });
}

void Progress::show(const std::string& stage, const std::string& bar, const std::string& text, bool last) {
  const std::lock_guard lock(mutex_);
  const bool due = stage != stage_ || last || Clock::now() - drawn_ >= redrawn;
  stage_ = stage;
  text_ = text;
  waiting_ = false;
  if (!terminal_) {
    if (!ticker_.joinable()) ticker_ = std::jthread([this](const std::stop_token& stop) { tick(stop); });
    return;
  }
  if (!due) return;
  drawn_ = Clock::now();
  draw(stage + "  " + bar + text);
}

/// Lines that are due by the time alone.
void Progress::tick(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (!stop.stop_requested()) {
    changed_.wait_for(lock, stop, terminal_ ? seconds_redrawn : every_, [] { return false; });
    if (stop.stop_requested() || stage_.empty()) continue;
    const std::string text = waiting_ ? duration_text(seconds_since(waiting_since_)) : text_;
    if (!terminal_) {
      std::fprintf(stderr, "deform: progress: %s  %s\n", printable(stage_).c_str(), printable(text).c_str());
    } else if (waiting_) {
      draw(stage_ + "  " + text);
    }
  }
}

void Progress::draw(const std::string& line) {
  std::fprintf(stderr, "\r\x1b[K%s", printable(line).c_str());
  std::fflush(stderr);
  visible_ = true;
}

void Progress::clear() {
  const std::lock_guard lock(mutex_);
  if (visible_) std::fprintf(stderr, "\r\x1b[K");
  std::fflush(stderr);
  visible_ = false;
  stage_.clear();
}

}  // namespace deform::cli
