#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>

namespace deform::cli {

/// Bytes that an entry of so many bytes takes in an archive: header and padding included.
std::uint64_t tar_entry_bytes(std::uint64_t bytes);

/// Writes a POSIX ustar archive of plain files. Not thread-safe. Throws Error(unavailable) when the disk is full.
class TarWriter {
 public:
  /// Goes on at `end` of an archive begun earlier: what stands behind is cut off. 0 begins a new one.
  TarWriter(const std::filesystem::path& path, std::uint64_t end);

  /// `name` at most 100 bytes. Flushed when this returns.
  void add(const std::string& name, const std::string& bytes);
  /// The two empty blocks that end an archive.
  void finish();
  std::uint64_t end() const { return end_; }

 private:
  void flush();

  const std::filesystem::path path_;
  std::ofstream file_;
  std::uint64_t end_;
};

}  // namespace deform::cli
