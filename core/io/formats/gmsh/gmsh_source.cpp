// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/gmsh/gmsh_source.h"

#include <cmath>

#include "core/base/error.h"
#include "core/io/binary/byte_order.h"

namespace deform::io {

GmshSource::GmshSource(std::string_view bytes, const std::string& name)
    : bytes_(bytes), name_(name), scanner_(bytes, name, Syntax::plain) {
  if (!next_section()) fail_at(0, "expected a Gmsh file, which begins with $MeshFormat");
  if (section_ == "NOD") fail_at(0, "version 1 of the MSH format is not supported, only 2, 4.0 and 4.1 (gmsh -save converts it)");
  if (section_ != "MeshFormat") fail_at(0, "expected a Gmsh file, which begins with $MeshFormat, found $" + section_);
  read_format();
}

void GmshSource::read_format() {
  const auto need = [this](const char* what) {
    if (!scanner_.next_in_file()) fail(std::string("the file ends where ") + what + " is expected");
  };
  need("the version of the format");
  const std::size_t at = scanner_.position();
  const double number = scanner_.number("the version of the format");
  if (number >= 2 && number < 3) {
    version_ = Version::v2;
  } else if (number == 4) {
    version_ = Version::v4_0;
  } else if (number == 4.1) {
    version_ = Version::v4_1;
  } else {
    scanner_.move_to(at);
    fail("version " + scanner_.quoted() + " of the MSH format is not supported, only 2, 4.0 and 4.1");
  }
  need("the type of the file");
  const std::size_t type_at = scanner_.position();
  const std::int64_t type = scanner_.whole_integer("the type of the file");
  if (type != 0 && type != 1) fail_at(type_at, "file type " + std::to_string(type) + ", expected 0 (text) or 1 (binary)");
  need("the size of data");
  const std::size_t size_at = scanner_.position();
  const std::int64_t size = scanner_.whole_integer("the size of data");
  if (size != 8 && !(version_ == Version::v4_1 && size == 4)) {
    fail_at(size_at, "data size " + std::to_string(size) + (version_ == Version::v4_1 ? ", expected 4 or 8" : ", expected 8"));
  }
  if (version_ == Version::v4_1) size_bytes_ = static_cast<std::size_t>(size);
  if (type == 1) read_order();
  end_section();
}

void GmshSource::read_order() {
  scanner_.skip_line();
  binary_ = raw_values_ = true;
  const std::size_t at = scanner_.position();
  const std::uint64_t one = raw(4, "the number 1");
  if (one == 0x01000000) {
    order_ = std::endian::big;
  } else if (one != 1) {
    fail_at(at, "expected the integer 1 in the byte order of the file");
  }
}

bool GmshSource::next_section() {
  while (scanner_.next_in_file() && scanner_.peek() != '$') scanner_.skip_line();
  if (scanner_.at_end()) return false;
  scanner_.advance(1);
  section_ = scanner_.word();
  raw_values_ = false;
  return true;
}

void GmshSource::begin_values() {
  if (binary_) scanner_.skip_line();
  raw_values_ = binary_;
}

void GmshSource::end_section() {
  raw_values_ = false;
  const std::string end = "$End" + section_;
  const std::size_t size = end.size();
  if (!scanner_.next_in_file() || bytes_.substr(scanner_.position(), size) != end) fail("expected " + end);
  scanner_.advance(size);
}

void GmshSource::skip_section() {
  const std::string end = "$End" + section_;
  const std::size_t found = bytes_.find(end, scanner_.position());
  if (found == std::string_view::npos) fail("the section $" + section_ + " has no " + end);
  scanner_.move_to(found + end.size());
}

std::uint64_t GmshSource::raw(std::size_t bytes, const char* what) {
  if (left() < bytes) fail(std::string("the file ends where ") + what + " is expected");
  const char* at = bytes_.data() + scanner_.position();
  scanner_.advance(bytes);
  return bytes == 4 ? load_scalar<std::uint32_t>(at, order_) : load_scalar<std::uint64_t>(at, order_);
}

std::size_t GmshSource::value_position() {
  if (!raw_values_) scanner_.next_in_file();
  return scanner_.position();
}

std::int64_t GmshSource::integer(const char* what) {
  if (raw_values_) return static_cast<std::int32_t>(static_cast<std::uint32_t>(raw(4, what)));
  scanner_.next_in_file();
  return scanner_.whole_integer(what);
}

std::uint64_t GmshSource::size(const char* what) {
  if (raw_values_) return raw(size_bytes_, what);
  const std::size_t at = value_position();
  const std::int64_t value = scanner_.whole_integer(what);
  if (value < 0) fail_at(at, std::string(what) + " is " + std::to_string(value));
  return static_cast<std::uint64_t>(value);
}

std::size_t GmshSource::count(const char* what, std::size_t least_text, std::size_t least_binary) {
  const std::size_t at = value_position();
  const std::uint64_t value = size(what);
  // The last item in text needs nothing behind it.
  const std::size_t room = binary_ ? left() / least_binary : (left() + 1) / least_text;
  if (value > room) {
    fail_at(at, std::string(what) + " is " + std::to_string(value) + ", the file has only " + std::to_string(left()) +
                    " bytes left for them");
  }
  return static_cast<std::size_t>(value);
}

std::int64_t GmshSource::tag(const char* what) {
  return raw_values_ && version_ == Version::v4_1 ? static_cast<std::int64_t>(raw(size_bytes_, what)) : integer(what);
}

double GmshSource::number(const char* what) {
  if (!raw_values_) {
    scanner_.next_in_file();
    return scanner_.number(what);
  }
  const std::size_t at = scanner_.position();
  const auto value = std::bit_cast<double>(raw(8, what));
  if (!std::isfinite(value)) fail_at(at, std::string(what) + " is not a finite number");
  return value;
}

void GmshSource::fail_at(std::size_t position, const std::string& message) const {
  if (!binary_) scanner_.fail_at(position, message);
  throw Error(ErrorCode::invalid_argument, name_ + ": byte " + std::to_string(position) + ": " + message);
}

}  // namespace deform::io
