// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "client/cli/sweep/durable_file.h"

namespace deform::cli {

/// What was found about a result when it was computed, so that a later run that finds it there can tell it again.
struct ResultVerdicts {
  std::vector<std::string> reasons;          ///< why it is bad, a sentence each; empty: it is not
  std::optional<double> safe_amplitude;      ///< of a result with inverted cells
  std::map<std::string, std::string> gates;  ///< conditions that were looked at, and how they failed; empty: they did not
  std::vector<std::string> doubts = {};      ///< why it is doubtful, or would be if it were not bad, a sentence each
  std::vector<std::string> warnings = {};    ///< what is striking about it, a sentence each
  /// How much of the motion it has made where a split did not arrive: final, but not the design that was asked for.
  std::optional<double> reached = {};
  /// The error of the points, and as a fraction of the largest displacement; unknown of results of earlier versions.
  std::optional<double> estimated_error = {}, relative_error = {};
};

/// Why a design has no result.
struct SweepFailure {
  std::string reason;
  std::string hash =
      {};  ///< design_hash() of one that is bad and was not written: computed again it would be the same; else empty
  ResultVerdicts verdicts = {};
};

/// One finished result.
struct ManifestEntry {
  /// The file of an archive that holds it. In folders always result.
  enum class Place {
    result,  ///< ARCHIVE
    part,    ///< ARCHIVE.part
    next,    ///< what ARCHIVE is about to be replaced with
  };
  std::string name;
  std::string hash;          ///< design_hash()
  std::string file;          ///< in the folder or archive
  std::uint64_t offset = 0;  ///< of the entry in the archive; 0 in a folder
  std::uint64_t bytes = 0;
  Place place = Place::result;
  ResultVerdicts verdicts = {};
};

/// The record of a sweep next to its results: a text file of JSON lines that grows by a line whenever something has happened; the
/// last line about a thing counts. A line without its end was torn by a crash and does not count. The file is locked while this
/// lives, so two sweeps never write to one place. Not thread-safe.
class Manifest {
 public:
  /// Reads what is there, or begins a new one. Throws Error(invalid_argument) when the file is no manifest of a sweep, which is
  /// left as it is, and Error(failed_precondition) when another sweep has it or it cannot be written.
  explicit Manifest(const std::filesystem::path& path);

  /// There was none before.
  bool is_new() const { return is_new_; }
  const std::map<std::string, ManifestEntry>& results() const { return results_; }  ///< by file
  const std::vector<ManifestEntry>& part() const { return part_; }                  ///< in order of their offsets
  const std::vector<ManifestEntry>& next() const { return next_; }
  /// Designs without a result, and why.
  const std::map<std::string, SweepFailure>& failed() const { return failed_; }
  /// The failure of a design with this hash.
  std::optional<SweepFailure> find_failure(const std::string& name, const std::string& hash) const;
  /// A file that was being replaced when its entry ended: it is ours, but may be the old or the new one.
  bool is_being_written(const std::string& file) const { return writing_.contains(file); }

  void add(const ManifestEntry& entry);
  void add(const std::vector<ManifestEntry>& entries);
  void fail(const std::string& name, const SweepFailure& failure);
  /// This file is about to be replaced, its entry does not hold any more. On the disk when this returns.
  void replace(const std::string& file);
  void sync() { file_.sync(); }
  /// A new file with these entries only, and failures of the names that are given, takes the place of the old one.
  void rewrite(const std::map<std::string, ManifestEntry>& results, const std::vector<ManifestEntry>& part,
               const std::set<std::string>& names);

 private:
  bool read();
  void take(const std::string& line);
  void take(ManifestEntry&& entry);

  DurableFile file_;
  bool is_new_ = false;
  std::map<std::string, ManifestEntry> results_;
  std::vector<ManifestEntry> part_, next_;
  std::map<std::string, SweepFailure> failed_;
  std::set<std::string> writing_;
};

}  // namespace deform::cli
