// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/io/formats/containers/container_file.h"

namespace deform::io {

/// A netCDF file, classic (32 and 64 bit) or netCDF-4, read through libnetcdf. The size of a variable is checked against that of
/// the file before anything is allocated. Holds the lock of the containers during its lifetime. Throws Error(invalid_argument)
/// naming file and variable.
class NetcdfFile {
 public:
  enum class Access { read, modify };

  /// `name` is used in errors. Unlinks `file`.
  NetcdfFile(ContainerFile& file, std::size_t bytes, std::string name, Access access);
  ~NetcdfFile();
  NetcdfFile(const NetcdfFile&) = delete;
  NetcdfFile& operator=(const NetcdfFile&) = delete;

  /// Writes pending data and closes the file. Write errors are reported only here.
  void close();

  std::optional<std::size_t> dimension(const std::string& name) const;
  bool has(const std::string& variable) const;
  /// The lengths of a variable; the last dimension varies fastest.
  std::vector<std::size_t> lengths(const std::string& variable) const;
  bool is_float(const std::string& variable) const;  ///< whether it has 32 bits

  /// All values of a variable; throws if they are of another kind.
  std::vector<std::int64_t> integers(const std::string& variable) const;
  std::vector<double> reals(const std::string& variable) const;
  /// Rows of characters, cut at the first 0 and without trailing blanks.
  std::vector<std::string> texts(const std::string& variable) const;
  /// An attribute, or an empty string.
  std::string attribute(const std::string& variable, const char* name) const;

  /// Overwrites all values of a variable of floats or doubles, which keeps its type. The size must match.
  void overwrite(const std::string& variable, std::span<const double> values);

  [[noreturn]] void fail(const std::string& variable, const std::string& what) const;

 private:
  void check(int status, const std::string& variable) const;  ///< throws with the message of the library
  int id(const std::string& variable) const;
  int type(const std::string& variable) const;
  std::size_t entries(const std::string& variable, std::size_t size) const;

  const std::unique_lock<std::mutex> lock_;
  const std::string name_;
  std::uint64_t most_bytes_ = 0;
  int file_ = 0;
  bool open_ = false;
};

}  // namespace deform::io
