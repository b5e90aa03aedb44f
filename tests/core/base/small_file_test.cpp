// SPDX-License-Identifier: GPL-3.0-or-later
// Why a file cannot be read.
#include "core/base/small_file.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

namespace deform::small_file_test {
namespace {

TEST(WhyUnreadable, IsInTheWordsOfTheSystem) {
  const std::filesystem::path folder = std::filesystem::temp_directory_path() / "why_unreadable_test";
  std::filesystem::create_directories(folder);
  std::ofstream(folder / "file") << "text";
  EXPECT_EQ(why_unreadable(folder / "file"), "");
  EXPECT_EQ(why_unreadable(folder / "missing"), "No such file or directory");
  EXPECT_EQ(why_unreadable(folder), "Is a directory");
  EXPECT_EQ(why_unreadable(folder / "file" / "inside"), "Not a directory");
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace deform::small_file_test
