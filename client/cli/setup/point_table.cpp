// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/setup/point_table.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <string_view>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/small_file.h"

namespace deform::cli {

namespace {

constexpr const char* axis_names = "xyz";

bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n'; }

std::string lower_extension(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(), [](unsigned char c) { return std::tolower(c); });
  return extension;
}

/// Whether numbers up to the end of `last` are separated by blanks alone, and others by commas between digits: "0,5 1,5 2", of
/// which x, y and z would be 0, 5 and 1.
bool has_decimal_commas(const std::string& text, std::size_t last) {
  const auto digit = [&](std::size_t i) { return i < text.size() && text[i] >= '0' && text[i] <= '9'; };
  bool between_digits = false, blanks_alone = false;
  for (std::size_t i = 1; i <= last && i < text.size(); ++i) {
    if (text[i] == ',' && digit(i - 1) && digit(i + 1)) between_digits = true;
    if (i < last && is_blank(text[i]) && digit(i - 1)) {
      std::size_t next = i;
      while (next < last && is_blank(text[next])) ++next;
      blanks_alone = blanks_alone || text[next] != ',';
    }
  }
  return between_digits && blanks_alone;
}

}  // namespace

bool PointTable::is_table(const std::filesystem::path& path) {
  const std::string extension = lower_extension(path);
  return extension == ".csv" || extension == ".xyz" || extension == ".txt";
}

PointTable::PointTable(const std::filesystem::path& input, const std::filesystem::path& output)
    : input_(input),
      output_(output),
      partial_(output.string() + ".partial"),
      csv_(lower_extension(input) == ".csv"),
      in_(input, std::ios::binary) {
  if (!in_) throw Error(ErrorCode::not_found, input.string() + ": cannot be opened: " + why_unreadable(input));
  out_.open(partial_, std::ios::binary | std::ios::trunc);
  if (!out_) throw Error(ErrorCode::failed_precondition, partial_.string() + ": cannot be written");
  try {
    pass_mark();
    if (csv_) read_header();
  } catch (...) {
    std::error_code ignored;
    std::filesystem::remove(partial_, ignored);
    throw;
  }
}

void PointTable::pass_mark() {
  constexpr std::string_view byte_order_mark = "\xef\xbb\xbf";  // as spreadsheets write it
  std::string begin(byte_order_mark.size(), '\0');
  in_.read(begin.data(), static_cast<std::streamsize>(begin.size()));
  if (in_ && begin == byte_order_mark) {
    out_ << begin;
    return;
  }
  in_.clear();
  in_.seekg(0);
}

PointTable::~PointTable() {
  if (committed_) return;
  out_.close();
  std::error_code ignored;
  std::filesystem::remove(partial_, ignored);
}

void PointTable::refuse_line(const std::string& what) const {
  throw Error(ErrorCode::invalid_argument, input_.string() + ":" + std::to_string(number_) + ": " + what);
}

bool PointTable::next_line(Line& line) {
  line = {};
  if (!std::getline(in_, line.text)) {
    if (in_.bad()) throw Error(ErrorCode::failed_precondition, input_.string() + ": cannot be read");
    return false;
  }
  if (!in_.eof()) line.text += '\n';
  ++number_;
  const auto first = std::find_if_not(line.text.begin(), line.text.end(), is_blank);
  line.point = first != line.text.end() && *first != '#';
  return true;
}

void PointTable::read_header() {
  Line line;
  while (next_line(line)) {
    const bool header = line.point;
    line.point = false;
    if (header) {
      std::vector<std::string> names;
      std::string name;
      if (line.text.find(',') == std::string::npos && line.text.find(';') != std::string::npos) separator_ = ';';
      for (const char c : line.text + separator_) {
        if (c == separator_) {
          names.push_back(std::exchange(name, {}));
        } else if (!is_blank(c) && c != '"') {
          name += c;
        }
      }
      header_size_ = names.size();
      for (std::size_t k = 0; k < 3; ++k) {
        const auto found = std::find(names.begin(), names.end(), std::string(1, axis_names[k]));
        if (found == names.end())
          refuse_line(std::string("the header has no column ") + axis_names[k] + "; x, y and z are needed");
        if (std::find(found + 1, names.end(), *found) != names.end()) refuse_line("the header has two columns " + *found);
        columns_[k] = static_cast<std::size_t>(found - names.begin());
      }
    }
    lines_.push_back(std::move(line));
    if (header) return;
  }
  throw Error(ErrorCode::invalid_argument, input_.string() + ": has no header with the columns x, y and z");
}

/// Finds the three numbers of a line.
void PointTable::split(Line& line) const {
  std::vector<Field> fields;
  const std::string& text = line.text;
  if (csv_) {
    bool quoted = false;
    std::size_t begin = 0;
    for (std::size_t i = 0; i <= text.size(); ++i) {
      if (i < text.size() && text[i] == '"') quoted = !quoted;
      if (i < text.size() && (quoted || text[i] != separator_)) continue;
      fields.push_back({begin, i - begin});
      begin = i + 1;
    }
    if (quoted) refuse_line("a quote is not closed");
    if (fields.size() != header_size_) {
      refuse_line(std::to_string(fields.size()) + " fields, the header has " + std::to_string(header_size_));
    }
  } else {
    const auto separates = [](char c) { return is_blank(c) || c == ','; };
    for (std::size_t i = 0; i < text.size() && fields.size() < 3;) {
      while (i < text.size() && separates(text[i])) ++i;
      const std::size_t begin = i;
      while (i < text.size() && !separates(text[i])) ++i;
      if (i > begin) fields.push_back({begin, i - begin});
    }
    if (fields.size() < 3) refuse_line("three numbers are needed, x, y and z");
    if (has_decimal_commas(text, fields.back().begin + fields.back().size)) {
      refuse_line("commas stand within numbers; decimals are written with a point");
    }
  }
  line.axis = {0, 1, 2};
  std::sort(line.axis.begin(), line.axis.end(), [&](std::size_t a, std::size_t b) { return columns_[a] < columns_[b]; });
  for (std::size_t k = 0; k < 3; ++k) {
    Field& field = line.fields[k] = fields[columns_[line.axis[k]]];
    const auto dropped = [&](char c) { return is_blank(c) || c == '"'; };
    while (field.size > 0 && dropped(text[field.begin])) ++field.begin, --field.size;
    while (field.size > 0 && dropped(text[field.begin + field.size - 1])) --field.size;
  }
}

Vec3 PointTable::point_of(const Line& line) const {
  Vec3 point{};
  for (std::size_t k = 0; k < 3; ++k) {
    const char* begin = line.text.data() + line.fields[k].begin;
    const char* const end = begin + line.fields[k].size;
    if (begin != end && *begin == '+') ++begin;
    double& value = point[line.axis[k]];
    const auto [parsed, error] = std::from_chars(begin, end, value);
    if (error != std::errc() || parsed != end || !std::isfinite(value)) {
      const bool comma = error == std::errc() && parsed != end && *parsed == ',';
      refuse_line(std::string(1, axis_names[line.axis[k]]) + ": \"" +
                  line.text.substr(line.fields[k].begin, line.fields[k].size) + "\" is no finite number" +
                  (comma ? "; decimals are written with a point" : ""));
    }
  }
  return point;
}

std::size_t PointTable::read(std::span<Vec3> points) {
  std::size_t count = 0;
  Line line;
  while (count < points.size() && next_line(line)) {
    if (line.point) {
      split(line);
      points[count++] = point_of(line);
    }
    const std::lock_guard lock(mutex_);
    lines_.push_back(std::move(line));
  }
  return count;
}

void PointTable::write_others() {
  for (;;) {
    Line line;
    {
      const std::lock_guard lock(mutex_);
      if (lines_.empty() || lines_.front().point) return;
      line = std::move(lines_.front());
      lines_.pop_front();
    }
    out_ << line.text;
  }
}

void PointTable::write(std::span<const Vec3> points) {
  char digits[32];
  for (const Vec3& point : points) {
    write_others();
    Line line;
    {
      const std::lock_guard lock(mutex_);
      if (lines_.empty()) throw Error(ErrorCode::internal, "more points are written than were read");
      line = std::move(lines_.front());
      lines_.pop_front();
    }
    std::size_t at = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const Field& field = line.fields[k];
      out_.write(line.text.data() + at, static_cast<std::streamsize>(field.begin - at));
      const auto end = std::to_chars(digits, digits + sizeof digits, point[line.axis[k]]).ptr;
      out_.write(digits, end - digits);
      at = field.begin + field.size;
    }
    out_.write(line.text.data() + at, static_cast<std::streamsize>(line.text.size() - at));
  }
  if (!out_) throw Error(ErrorCode::failed_precondition, partial_.string() + ": cannot be written, is the disk full?");
}

void PointTable::commit() {
  write_others();
  out_.close();
  if (!out_) throw Error(ErrorCode::failed_precondition, partial_.string() + ": cannot be written, is the disk full?");
  std::error_code error;
  std::filesystem::rename(partial_, output_, error);
  if (error) throw Error(ErrorCode::failed_precondition, output_.string() + ": " + error.message());
  committed_ = true;
}

}  // namespace deform::cli
