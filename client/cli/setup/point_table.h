// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <span>
#include <string>

#include "core/base/types.h"

namespace deform::cli {

/// A table of points that is read, and written with other coordinates, line by line, so that it may be of any length:
///  .csv         separated by commas, or by semicolons where the header has no comma; the first line with content is the header,
///  with
///               the columns x, y and z
///  .xyz, .txt   three numbers in each line, separated by blanks or commas
/// Everything else is kept byte for byte: other columns, blank lines, comments (#). One thread may read while another writes.
class PointTable {
 public:
  /// Whether the name is that of a table.
  static bool is_table(const std::filesystem::path& path);

  /// Opens both. What is written has another name until commit(). Throws Error(not_found), Error(invalid_argument) for a table
  /// without the columns, Error(failed_precondition) where nothing can be written.
  PointTable(const std::filesystem::path& input, const std::filesystem::path& output);
  /// Removes what was written without a commit().
  ~PointTable();
  PointTable(const PointTable&) = delete;
  PointTable& operator=(const PointTable&) = delete;

  /// The next points; 0 at the end. Throws Error(invalid_argument) naming file, line and column.
  std::size_t read(std::span<Vec3> points);
  /// Writes the next points in their lines.
  void write(std::span<const Vec3> points);
  /// Writes what follows the last point, and gives the file its name.
  void commit();

 private:
  /// Where a number stands in its line.
  struct Field {
    std::size_t begin = 0, size = 0;
  };
  struct Line {
    std::string text;             ///< with its end
    std::array<Field, 3> fields;  ///< of x, y, z in ascending order of the columns
    std::array<std::size_t, 3> axis{};
    bool point = false;
  };

  bool next_line(Line& line);
  /// The byte order mark of UTF-8 that a file may begin with stays in the output.
  void pass_mark();
  void read_header();
  void split(Line& line) const;
  Vec3 point_of(const Line& line) const;
  void write_others();
  [[noreturn]] void refuse_line(const std::string& what) const;

  const std::filesystem::path input_, output_, partial_;
  const bool csv_;
  std::ifstream in_;
  std::ofstream out_;
  std::uint64_t number_ = 0;  ///< of the line read last, from 1
  std::array<std::size_t, 3> columns_{0, 1, 2};
  std::size_t header_size_ = 0;  ///< columns of a CSV file
  char separator_ = ',';         ///< of a CSV file
  bool committed_ = false;
  std::mutex mutex_;
  std::deque<Line> lines_;  ///< read and not written yet; under mutex_
};

}  // namespace deform::cli
