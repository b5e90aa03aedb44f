#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "client/cli/sweep_designs.h"

namespace deform::cli {

/// One finished result in the manifest: a text file of JSON lines that grows by one line after each result is safely there. A
/// line that was torn by a crash does not count.
struct ManifestEntry {
  std::string name;
  std::string hash;          ///< design_hash()
  std::string file;          ///< in the folder or archive
  std::uint64_t offset = 0;  ///< of the entry in the archive; 0 in a folder
  std::uint64_t bytes = 0;
};

/// Where the results of a sweep go; what is there already is known and kept. Thread-safe.
class SweepOutput {
 public:
  virtual ~SweepOutput() = default;
  /// This result is there from an earlier run.
  virtual bool has(const std::string& name, const std::string& hash) const = 0;
  /// Stores a result; it counts only when it is complete.
  virtual void put(const std::string& name, const std::string& hash, const std::string& bytes) = 0;
  /// All results are there.
  virtual void finish() = 0;
};

/// Expected results by name, with their hashes: what is stored but not expected must not stand in an archive.
using ExpectedResults = std::map<std::string, std::string>;

/// A folder, or an archive when the path ends in .tar. `extension` is that of the files (".obj", ".off.gz"). An archive is
/// written as PATH.part and gets its name in finish(). Throws Error(invalid_argument) when the place cannot be used.
std::unique_ptr<SweepOutput> open_sweep_output(const std::filesystem::path& path, const std::string& extension,
                                               const ExpectedResults& expected);

}  // namespace deform::cli
