// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client/cli/sweep/manifest.h"

namespace deform::cli {

/// The extension of the results of an OpenFOAM mesh, which are time folders.
inline constexpr char openfoam_result[] = "/polyMesh/points";

/// A result of the sweep as it is now.
struct ExpectedResult {
  std::string name;
  std::string hash;  ///< design_hash()
};

/// Where the results of a sweep go; what is there already is known and kept. Thread-safe. A full disk is an
/// Error(failed_precondition) naming the file; whatever was finished before stays finished.
class SweepOutput {
 public:
  virtual ~SweepOutput() = default;
  /// What was found about this result when it was computed; nothing when it is not there.
  virtual std::optional<ResultVerdicts> find(const ExpectedResult& result) const = 0;
  /// Stores a result. It is on the disk when this returns, and recorded after that.
  virtual void put(const ExpectedResult& result, const ResultVerdicts& verdicts, const std::string& bytes) = 0;
  /// Records why a design has no result. It is tried again by the next run, unless the failure has the hash of its result.
  virtual void fail(const std::string& name, const SweepFailure& failure) = 0;
  /// What was found about this result when it was not written because it is bad; nothing when that is not known.
  virtual std::optional<SweepFailure> find_failure(const ExpectedResult& result) const = 0;
  /// Nothing more comes: an archive gets its name and holds the expected results that are there.
  virtual void finish() = 0;
};

/// A folder, or an archive when the path ends in .tar. `extension` is that of the files (".obj", ".off.gz"). Throws
/// Error(invalid_argument) when the place cannot be used, or holds what is not of a sweep and would be overwritten: that is left
/// as it is.
std::unique_ptr<SweepOutput> open_sweep_output(const std::filesystem::path& path, const std::string& extension,
                                               std::vector<ExpectedResult> expected);

}  // namespace deform::cli
