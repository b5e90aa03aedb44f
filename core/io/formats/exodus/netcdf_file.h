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

/// A netCDF file, classic (32 and 64 bit) or netCDF-4, through libnetcdf. What a variable claims to hold is checked against the
/// size of the file before anything is allocated. Holds the lock of the containers while it lives. Errors are
/// Error(invalid_argument) naming file and variable.
class NetcdfFile {
 public:
  enum class Access { read, modify };

  /// `name` stands in errors. `file` loses its name.
  NetcdfFile(ContainerFile& file, std::size_t bytes, std::string name, Access access);
  ~NetcdfFile();
  NetcdfFile(const NetcdfFile&) = delete;
  NetcdfFile& operator=(const NetcdfFile&) = delete;

  /// Writes what is not yet written and gives up the file; errors are only seen here.
  void close();

  std::optional<std::size_t> dimension(const std::string& name) const;
  bool has(const std::string& variable) const;
  /// Lengths of a variable, the last varies fastest.
  std::vector<std::size_t> lengths(const std::string& variable) const;
  bool is_float(const std::string& variable) const;  ///< 32 bits

  /// All of a variable; numbers that are not of the wanted kind are refused.
  std::vector<std::int64_t> integers(const std::string& variable) const;
  std::vector<double> reals(const std::string& variable) const;
  /// Rows of characters without what follows the first 0 and the blanks before it.
  std::vector<std::string> texts(const std::string& variable) const;
  /// Empty when there is none.
  std::string attribute(const std::string& variable, const char* name) const;

  /// All of a variable of floats or doubles, which keeps its type; the size must be the same.
  void overwrite(const std::string& variable, std::span<const double> values);

  [[noreturn]] void fail(const std::string& variable, const std::string& what) const;

 private:
  void check(int status, const std::string& variable) const;  ///< the library's own words
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
