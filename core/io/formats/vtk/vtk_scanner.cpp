// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/vtk/vtk_scanner.h"

#include <bit>
#include <charconv>
#include <cmath>

#include "core/base/error.h"
#include "core/base/text.h"
#include "core/io/binary/byte_order.h"

namespace deform::io {

namespace {

using Kind = VtkType::Kind;

// vtkIdType is 32 bits in these files whatever it is in memory (VTK file formats, legacy).
constexpr VtkType scalar_types[] = {
    {"bit", 1, Kind::unsigned_integer},
    {"char", 8, Kind::signed_integer},
    {"signed_char", 8, Kind::signed_integer},
    {"unsigned_char", 8, Kind::unsigned_integer},
    {"short", 16, Kind::signed_integer},
    {"unsigned_short", 16, Kind::unsigned_integer},
    {"int", 32, Kind::signed_integer},
    {"unsigned_int", 32, Kind::unsigned_integer},
    {"vtkidtype", 32, Kind::signed_integer},
    {"long", 64, Kind::signed_integer},
    {"unsigned_long", 64, Kind::unsigned_integer},
    {"vtktypeint64", 64, Kind::signed_integer},
    {"vtktypeuint64", 64, Kind::unsigned_integer},
    {"float", 32, Kind::floating},
    {"double", 64, Kind::floating},
    {"string", 0, Kind::text},
    {"utf8_string", 0, Kind::text},
};

std::string percent_decoded(std::string_view text) {
  std::string decoded;
  for (std::size_t i = 0; i < text.size(); ++i) {
    unsigned value = 0;
    if (text[i] == '%' && i + 2 < text.size()) {
      const char* end = text.data() + i + 3;
      if (std::from_chars(text.data() + i + 1, end, value, 16).ptr == end) {
        decoded += static_cast<char>(value);
        i += 2;
        continue;
      }
    }
    decoded += text[i];
  }
  return decoded;
}

}  // namespace

void VtkScanner::fail_at(std::size_t position, const std::string& message) const {
  if (!binary_) scanner_.fail_at(position, message);
  throw Error(ErrorCode::invalid_argument, name_ + ": byte " + std::to_string(position) + ": " + message);
}

void VtkScanner::read_header() {
  const std::string_view magic = "# vtk datafile version ";
  if (lower_case(bytes_.substr(0, magic.size())) != magic) fail_at(0, "expected \"# vtk DataFile Version\"");
  scanner_.move_to(magic.size());
  const std::int64_t version = scanner_.next_in_line() ? scanner_.integer("the version") : 0;
  if (version < 1 || version > 5) fail_at(magic.size(), "version " + std::to_string(version) + ", only 1 to 5 are supported");
  major_version_ = static_cast<int>(version);
  scanner_.skip_line();
  scanner_.skip_line();  // the title
  const std::size_t at = position();
  const std::string form = keyword("ASCII or BINARY");
  if (form != "ascii" && form != "binary") fail_at(at, "expected ASCII or BINARY, found \"" + form.substr(0, 24) + "\"");
  binary_ = form == "binary";
}

std::string VtkScanner::keyword(const char* what) {
  if (at_end()) fail_at(position(), std::string("the file ends where ") + what + " is expected");
  return lower_case(scanner_.name());
}

std::string VtkScanner::word(const char* what) {
  if (at_end()) fail_at(position(), std::string("the file ends where ") + what + " is expected");
  return percent_decoded(scanner_.name());
}

std::uint64_t VtkScanner::count(const char* what) {
  if (at_end()) fail_at(position(), std::string("the file ends where ") + what + " is expected");
  const std::size_t at = position();
  const std::int64_t value = scanner_.whole_integer(what);
  if (value < 0) fail_at(at, std::string(what) + " is " + std::to_string(value));
  return static_cast<std::uint64_t>(value);
}

const VtkType* VtkScanner::type() {
  const std::string name = keyword("a data type");
  for (const VtkType& type : scalar_types) {
    if (type.name == name) return &type;
  }
  return nullptr;
}

void VtkScanner::begin_array(const VtkType& type, std::uint64_t count, std::uint64_t components, const char* what) {
  const std::size_t at = position();
  // Exactly one line end before binary data, which may look like white space.
  if (binary_ || type.kind == Kind::text) {
    scanner_.skip_line();
  } else {
    scanner_.next_in_file();
  }
  // Bits, or in text a digit and a blank (the last value of a file needs no blank).
  const std::uint64_t bits = binary_ ? std::max<std::uint64_t>(type.bits, 1) : type.kind == Kind::text ? 8 : 16;
  const std::uint64_t room = 8 * (left() + 1);
  if (count == 0 || components == 0 ||
      (count <= room / bits / components && (!binary_ || count * components * type.bits <= 8 * left()))) {
    return;
  }
  fail_at(at, std::string(what) + ": " + std::to_string(count) + " x " + std::to_string(components) + " values of type " +
                  std::string(type.name) + ", the file has only " + std::to_string(left()) + " bytes left for them");
}

double VtkScanner::number(const VtkType& type, const char* what) {
  if (!binary_) {
    if (at_end()) fail_at(position(), std::string("the file ends where ") + what + " is expected");
    return scanner_.number(what);
  }
  const char* at = bytes_.data() + position();
  const double value = type.bits == 64
                           ? std::bit_cast<double>(load_scalar<std::uint64_t>(at, std::endian::big))
                           : static_cast<double>(std::bit_cast<float>(load_scalar<std::uint32_t>(at, std::endian::big)));
  if (!std::isfinite(value)) fail_at(position(), std::string(what) + " is not a finite number");
  scanner_.advance(type.bits / 8);
  return value;
}

std::int64_t VtkScanner::integer(const VtkType& type, const char* what) {
  if (!binary_) {
    if (at_end()) fail_at(position(), std::string("the file ends where ") + what + " is expected");
    return scanner_.whole_integer(what);
  }
  const char* at = bytes_.data() + position();
  scanner_.advance(type.bits / 8);
  const bool with_sign = type.kind == Kind::signed_integer;
  switch (type.bits) {
    case 8:
      return with_sign ? std::int64_t{static_cast<signed char>(*at)} : std::int64_t{static_cast<unsigned char>(*at)};
    case 16: {
      const auto value = load_scalar<std::uint16_t>(at, std::endian::big);
      return with_sign ? std::int64_t{static_cast<std::int16_t>(value)} : std::int64_t{value};
    }
    case 32: {
      const auto value = load_scalar<std::uint32_t>(at, std::endian::big);
      return with_sign ? std::int64_t{static_cast<std::int32_t>(value)} : std::int64_t{value};
    }
    default:
      return static_cast<std::int64_t>(load_scalar<std::uint64_t>(at, std::endian::big));
  }
}

void VtkScanner::skip_string() {
  if (!binary_) return scanner_.skip_line();
  if (left() == 0) fail_at(position(), "the file ends in an array of strings");
  // The two highest bits say how many bytes hold the length: 8, 4, 2 or 1.
  const auto first = static_cast<unsigned char>(bytes_[position()]);
  const std::size_t bytes = std::size_t{8} >> (first >> 6);
  if (left() < bytes) fail_at(position(), "the file ends in an array of strings");
  std::uint64_t length = first & 0x3f;
  for (std::size_t i = 1; i < bytes; ++i) length = length << 8 | static_cast<unsigned char>(bytes_[position() + i]);
  if (length > left() - bytes) {
    fail_at(position(), "a string of " + std::to_string(length) + " bytes, the file has only " + std::to_string(left() - bytes));
  }
  scanner_.advance(bytes + static_cast<std::size_t>(length));
}

void VtkScanner::skip_array(const VtkType& type, std::uint64_t count) {
  if (type.kind == Kind::text) {
    for (std::uint64_t i = 0; i < count; ++i) skip_string();
  } else if (binary_) {
    scanner_.advance(static_cast<std::size_t>((count * type.bits + 7) / 8));
  } else {
    for (std::uint64_t i = 0; i < count; ++i) {
      if (at_end()) fail_at(position(), "the file ends in an array of " + std::to_string(count) + " values");
      scanner_.name();
    }
  }
}

void VtkScanner::skip_metadata() {
  scanner_.skip_line();
  while (!scanner_.at_end() && scanner_.next_in_line()) scanner_.skip_line();
}

}  // namespace deform::io
