// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace deform::client {

/// Comma-separated text: first row with content is the header; fields may stand in double quotes; blank lines and lines that
/// start with # are skipped; blanks around fields are dropped. Where the header has semicolons and no comma, these separate, as
/// in files of spreadsheets whose language has decimal commas; decimals have a point all the same.
struct Csv {
  struct Row {
    std::size_t line = 0;             ///< from 1
    std::vector<std::string> fields;  ///< as many as the header has
  };
  /// A row that is none; with BadRows::keep only.
  struct BadRow {
    std::size_t line = 0;
    std::vector<std::string> fields;  ///< as far as they could be separated
    std::string reason;               ///< with name and line
  };
  std::string name;  ///< for errors
  std::vector<std::string> header;
  std::vector<Row> rows;
  std::vector<BadRow> bad_rows;

  /// "name:line: column: "
  std::string where(const Row& row, std::size_t column) const;
  /// Throws Error(invalid_argument) naming line and column when the field is no finite number.
  double number(const Row& row, std::size_t column) const;
};

/// What becomes of a row with more or fewer fields than the header, or an open quote.
enum class BadRows { refuse, keep };

/// Throws Error(invalid_argument): no header, empty or repeated column name, a bad row unless they are kept.
Csv parse_csv(const std::string& text, const std::string& name, BadRows bad_rows = BadRows::refuse);
Csv read_csv(const std::filesystem::path& path, BadRows bad_rows = BadRows::refuse);

}  // namespace deform::client
