// SPDX-License-Identifier: GPL-3.0-or-later
// What a command says in a pipe or a log while it computes for long.
#include "client/cli/output/progress.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <string>
#include <thread>

namespace deform::progress_test {
namespace {

using namespace std::chrono_literals;

/// What is written to stderr, which is no terminal here.
std::string written(const std::function<void()>& body) {
  testing::internal::CaptureStderr();
  body();
  return testing::internal::GetCapturedStderr();
}

std::ptrdiff_t lines(const std::string& text) { return std::count(text.begin(), text.end(), '\n'); }

TEST(Progress, IsALineFromTimeToTimeWhereThereIsNoTerminal) {
  const std::string text = written([] {
    cli::Progress progress(20ms);
    progress.wait("deform in steps");
    std::this_thread::sleep_for(500ms);
  });
  EXPECT_EQ(text.rfind("deform: progress: deform in steps  ", 0), 0u) << text;
  EXPECT_NE(text.find(" ms\n"), std::string::npos) << text;
  EXPECT_GE(lines(text), 3) << text;
  EXPECT_LE(lines(text), 25) << text;
  EXPECT_EQ(text.find('\x1b'), std::string::npos) << text;
}

TEST(Progress, SaysHowFarItIs) {
  const std::string text = written([] {
    cli::Progress progress(20ms);
    progress.count("sweep", 0, 40);
    std::this_thread::sleep_for(200ms);
    progress.count("sweep", 3, 40);
    std::this_thread::sleep_for(300ms);
    progress.fraction("factor", 0.25);
    std::this_thread::sleep_for(300ms);
  });
  EXPECT_NE(text.find("deform: progress: sweep  0/40\n"), std::string::npos) << text;
  EXPECT_NE(text.find("deform: progress: sweep  3/40  "), std::string::npos) << text;
  EXPECT_NE(text.find(" left\n"), std::string::npos) << text;
  EXPECT_NE(text.find("deform: progress: factor   25 %\n"), std::string::npos) << text;
}

TEST(Progress, IsSilentWhereNothingTakesLongOrNothingIsDone) {
  EXPECT_EQ(written([] {
              cli::Progress progress;
              progress.wait("deform");
              for (std::size_t i = 0; i <= 1000; ++i) progress.count("sweep", i, 1000);
            }),
            "");
  EXPECT_EQ(written([] {
              cli::Progress progress(200ms);
              progress.count("sweep", 1, 2);
              progress.clear();
              std::this_thread::sleep_for(500ms);
            }),
            "");
}

}  // namespace
}  // namespace deform::progress_test
