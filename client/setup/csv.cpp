// SPDX-License-Identifier: Apache-2.0
#include "client/setup/csv.h"

#include <set>

#include "client/setup/numbers.h"
#include "core/base/error.h"
#include "core/io/mesh_file.h"

namespace deform::client {

namespace {

std::string trimmed(const std::string& text) {
  const auto first = text.find_first_not_of(" \t\r");
  if (first == std::string::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t\r") - first + 1);
}

[[noreturn]] void refuse_line(const std::string& name, std::size_t line, const std::string& why) {
  throw Error(ErrorCode::invalid_argument, name + ":" + std::to_string(line) + ": " + why);
}

struct SplitLine {
  std::vector<std::string> fields;
  bool open_quote = false;
};

SplitLine split(const std::string& line, char separator) {
  SplitLine result;
  std::string field;
  bool quoted = false, was_quoted = false;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const char c = line[i];
    if (quoted) {
      if (c != '"') {
        field += c;
      } else if (i + 1 < line.size() && line[i + 1] == '"') {
        field += line[++i];
      } else {
        quoted = false;
      }
    } else if (c == '"' && trimmed(field).empty()) {
      quoted = was_quoted = true;
      field.clear();
    } else if (c == separator) {
      result.fields.push_back(was_quoted ? field : trimmed(field));
      field.clear();
      was_quoted = false;
    } else if (!(was_quoted && (c == ' ' || c == '\t' || c == '\r'))) {
      field += c;
    }
  }
  result.open_quote = quoted;
  result.fields.push_back(was_quoted ? field : trimmed(field));
  return result;
}

/// The separator of a header line: a semicolon if there are some and no commas, outside of quotes.
char separator_of(const std::string& header) {
  char separator = ',';
  bool quoted = false;
  for (const char c : header) {
    if (c == '"') quoted = !quoted;
    if (quoted) continue;
    if (c == ',') return c;
    if (c == ';') separator = c;
  }
  return separator;
}

/// "0.03" for "0,03"; empty for what is no number with a decimal comma.
std::string with_point(std::string text) {
  const std::size_t comma = text.find(',');
  if (comma == std::string::npos) return {};
  text[comma] = '.';
  return parse_number(text) ? text : std::string();
}

void check_header(const Csv& csv, std::size_t line) {
  std::set<std::string> seen;
  for (std::size_t k = 0; k < csv.header.size(); ++k) {
    if (csv.header[k].empty()) refuse_line(csv.name, line, "column " + std::to_string(k + 1) + " has no name");
    if (!seen.insert(csv.header[k]).second) refuse_line(csv.name, line, "two columns are named \"" + csv.header[k] + "\"");
  }
}

}  // namespace

std::string Csv::where(const Row& row, std::size_t column) const {
  return name + ":" + std::to_string(row.line) + ": " + header.at(column) + ": ";
}

double Csv::number(const Row& row, std::size_t column) const {
  const auto value = parse_number(row.fields.at(column));
  if (!value) {
    const std::string pointed = with_point(row.fields[column]);
    throw Error(ErrorCode::invalid_argument,
                where(row, column) + "expected a finite number, got \"" + row.fields[column].substr(0, 40) + "\"" +
                    (pointed.empty() ? "" : "; decimals are written with a point: " + pointed.substr(0, 40)));
  }
  return *value;
}

Csv parse_csv(const std::string& text, const std::string& name, BadRows bad_rows) {
  Csv csv;
  csv.name = name;
  std::size_t begin = text.starts_with("\xef\xbb\xbf") ? 3 : 0;  // a byte order mark, as spreadsheets write it
  char separator = ',';
  for (std::size_t line = 1; begin < text.size(); ++line) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    const std::string content = text.substr(begin, end - begin);
    begin = end + 1;
    const std::string bare = trimmed(content);
    if (bare.empty() || bare.front() == '#') continue;
    if (csv.header.empty()) separator = separator_of(content);
    SplitLine found = split(content, separator);
    std::string problem = found.open_quote ? "a quote is not closed" : "";
    if (csv.header.empty()) {
      if (!problem.empty()) refuse_line(name, line, problem);
      csv.header = std::move(found.fields);
      check_header(csv, line);
      continue;
    }
    if (problem.empty() && found.fields.size() != csv.header.size()) {
      problem = std::to_string(found.fields.size()) + " fields, the header has " + std::to_string(csv.header.size());
    }
    if (problem.empty()) {
      csv.rows.push_back({line, std::move(found.fields)});
    } else if (bad_rows == BadRows::refuse) {
      refuse_line(name, line, problem);
    } else {
      csv.bad_rows.push_back({line, std::move(found.fields), name + ":" + std::to_string(line) + ": " + problem});
    }
  }
  if (csv.header.empty()) throw Error(ErrorCode::invalid_argument, name + ": empty, expected a header line");
  return csv;
}

Csv read_csv(const std::filesystem::path& path, BadRows bad_rows) {
  constexpr std::size_t max_bytes = std::size_t{1} << 32;
  return parse_csv(io::read_file(path, nullptr, max_bytes), path.string(), bad_rows);
}

}  // namespace deform::client
