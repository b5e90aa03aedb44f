// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "client/cli/sweep/sweep_output.h"
#include "client/cli/sweep/tar.h"

namespace deform::cli {

/// All results in ARCHIVE, which is never opened for writing: results are appended to ARCHIVE.part, and in the end that takes the
/// place of ARCHIVE; or, where results of an earlier run are kept, both are copied together into ARCHIVE.part.new, which does.
/// ARCHIVE.manifest says what is where, and before a rename what will be: so whenever it is cut short, one of the two fits.
class SweepArchive : public SweepOutput {
 public:
  SweepArchive(const std::filesystem::path& path, std::string extension, std::vector<ExpectedResult> expected);

  std::optional<ResultVerdicts> find(const ExpectedResult& result) const override;
  void put(const ExpectedResult& result, const ResultVerdicts& verdicts, const std::string& bytes) override;
  void fail(const std::string& name, const SweepFailure& failure) override;
  std::optional<SweepFailure> find_failure(const ExpectedResult& result) const override;
  void finish() override;

 private:
  using Results = std::map<std::string, ManifestEntry>;

  void recover();
  Results recovered_results();
  std::vector<ManifestEntry> recovered_part(const Results& results) const;
  std::vector<ManifestEntry> wanted() const;
  std::vector<ManifestEntry> assemble(const std::vector<ManifestEntry>& entries) const;
  void replace(const std::filesystem::path& by, const std::vector<ManifestEntry>& next);
  std::set<std::string> names() const;

  const std::filesystem::path path_, part_, new_;
  const std::string extension_;
  const std::vector<ExpectedResult> expected_;
  mutable std::mutex mutex_;
  // under mutex_
  Manifest manifest_;
  std::map<std::pair<std::string, std::string>, ManifestEntry> present_;  ///< by name and hash
  std::set<std::string> failed_;                                          ///< names of this run
  std::unique_ptr<TarWriter> tar_;                                        ///< of the part; made for the first result
};

}  // namespace deform::cli
