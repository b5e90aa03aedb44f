#pragma once

#include <filesystem>
#include <fstream>
#include <vector>

#include "client/cli/sweep_output.h"

namespace deform::cli {

/// The record of finished results next to them. Not thread-safe.
class Manifest {
 public:
  /// Reads what is there. Lines that are no complete entries end it: they and what follows are dropped.
  explicit Manifest(std::filesystem::path path);

  const std::vector<ManifestEntry>& entries() const { return entries_; }
  /// Appends one line and flushes it.
  void add(const ManifestEntry& entry);
  /// Rewrites the file with these entries only.
  void reset(std::vector<ManifestEntry> entries);

 private:
  void write(const ManifestEntry& entry);

  const std::filesystem::path path_;
  std::vector<ManifestEntry> entries_;
  std::ofstream file_;
};

}  // namespace deform::cli
