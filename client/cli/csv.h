#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace deform::cli {

/// Comma-separated text: first row with content is the header; fields may stand in double quotes; blank lines and lines that
/// start with # are skipped; blanks around fields are dropped.
struct Csv {
  struct Row {
    std::size_t line = 0;             ///< from 1
    std::vector<std::string> fields;  ///< as many as the header has
  };
  std::string name;  ///< for errors
  std::vector<std::string> header;
  std::vector<Row> rows;

  /// "name:line: column: "
  std::string where(const Row& row, std::size_t column) const;
  /// Throws Error(invalid_argument) naming line and column when the field is no finite number.
  double number(const Row& row, std::size_t column) const;
};

/// Throws Error(invalid_argument): no header, empty or repeated column name, a row with more or fewer fields, an open quote.
Csv parse_csv(const std::string& text, const std::string& name);
Csv read_csv(const std::filesystem::path& path);

}  // namespace deform::cli
