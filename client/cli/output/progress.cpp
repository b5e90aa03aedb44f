// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/output/progress.h"

#include <unistd.h>

#include <algorithm>
#include <cstdio>

#include "client/cli/output/format.h"
#include "core/base/text.h"

namespace deform::cli {

namespace {

std::string bar(double done) {
  constexpr int width = 30;
  const int filled = static_cast<int>(std::clamp(done, 0.0, 1.0) * width);
  std::string text(width + 2, '.');
  std::fill_n(text.begin() + 1, filled, '#');
  text.front() = '[';
  text.back() = ']';
  return text;
}

}  // namespace

Progress::Progress() : terminal_(isatty(STDERR_FILENO) == 1) {}

Progress::~Progress() { clear(); }

void Progress::fraction(const std::string& stage, double done) {
  if (!terminal_) return;
  const std::lock_guard lock(mutex_);
  if (!due(stage, done >= 1)) return;
  char percent[16];
  std::snprintf(percent, sizeof(percent), "%3.0f %%", 100 * std::clamp(done, 0.0, 1.0));
  draw(stage + "  " + bar(done) + "  " + percent);
}

void Progress::count(const std::string& stage, std::size_t done, std::size_t total) {
  if (!terminal_ || total == 0) return;
  const std::lock_guard lock(mutex_);
  if (!due(stage, done == total)) return;
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - started_).count();
  std::string line = stage + "  " + bar(static_cast<double>(done) / static_cast<double>(total)) + "  " + std::to_string(done) +
                     "/" + std::to_string(total);
  if (done > 0 && seconds > 0) {
    const double rate = static_cast<double>(done) / seconds;
    char text[96];
    std::snprintf(text, sizeof(text), "  %.3g/s  %s left", rate, duration_text(static_cast<double>(total - done) / rate).c_str());
    line += text;
  }
  draw(line);
}

bool Progress::due(const std::string& stage, bool last) {
  const auto now = std::chrono::steady_clock::now();
  if (stage == stage_ && !last && now - drawn_ < std::chrono::milliseconds(100)) return false;
  stage_ = stage;
  drawn_ = now;
  return true;
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
}

}  // namespace deform::cli
