// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdlib>
#include <filesystem>
#include <string>

namespace deform::test {

/// A temporary folder that no other test uses at the same time.
class OwnTemporaryFolder {
 public:
  OwnTemporaryFolder() : before_(std::filesystem::temp_directory_path()) {
    std::string pattern = (before_ / "deform_test_XXXXXX").string();
    folder_ = mkdtemp(pattern.data());
    setenv("TMPDIR", folder_.c_str(), 1);
  }
  ~OwnTemporaryFolder() {
    setenv("TMPDIR", before_.c_str(), 1);
    std::filesystem::remove_all(folder_);
  }
  OwnTemporaryFolder(const OwnTemporaryFolder&) = delete;
  OwnTemporaryFolder& operator=(const OwnTemporaryFolder&) = delete;

  const std::filesystem::path& path() const { return folder_; }
  bool empty() const { return std::filesystem::is_empty(folder_); }

 private:
  std::filesystem::path before_, folder_;
};

}  // namespace deform::test
