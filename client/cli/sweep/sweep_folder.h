// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <map>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "client/cli/sweep/sweep_output.h"

namespace deform::cli {

/// One file per result, and sweep.manifest beside them. A result is written under another name and synced; then the manifest says
/// that its file is being replaced, it gets its name, and only then an entry. Whenever that is cut short, the manifest names the
/// files that are whole, and tells ours from those that were there before.
class SweepFolder : public SweepOutput {
 public:
  SweepFolder(const std::filesystem::path& path, std::string extension, std::vector<ExpectedResult> expected);

  std::optional<ResultVerdicts> find(const ExpectedResult& result) const override;
  void put(const ExpectedResult& result, const ResultVerdicts& verdicts, const std::string& bytes) override;
  void fail(const std::string& name, const SweepFailure& failure) override;
  std::optional<SweepFailure> find_failure(const ExpectedResult& result) const override;
  void finish() override;

 private:
  void refuse_foreign_files() const;
  void remove_torn_files() const;
  void make_folders(const std::string& file) const;
  std::string other_form(const std::string& file) const;
  std::map<std::string, ManifestEntry> whole_results() const;
  std::set<std::string> names() const;

  const std::filesystem::path path_;
  const std::string extension_;
  const std::vector<ExpectedResult> expected_;
  mutable std::mutex mutex_;
  // under mutex_
  Manifest manifest_;
  std::set<std::string> failed_;  ///< names of this run
};

}  // namespace deform::cli
