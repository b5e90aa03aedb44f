// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/ply/ply_source.h"

#include <cmath>

#include "core/base/error.h"
#include "core/io/binary/byte_order.h"

namespace deform::io {

PlyTextSource::PlyTextSource(std::string_view bytes, const std::string& name, const PlyHeader& header)
    : scanner_(bytes, name, Syntax::plain), size_(bytes.size()) {
  scanner_.move_to(header.end);
}

std::size_t PlyTextSource::next(PlyType) {
  if (!scanner_.next_in_file()) scanner_.fail("expected another value, found the end of the file");
  return scanner_.position();
}

void PlyTextSource::skip(PlyType type, std::uint64_t count) {
  for (std::uint64_t i = 0; i < count; ++i) {
    next(type);
    if (scanner_.word().empty()) scanner_.fail("expected a value, found " + scanner_.quoted());
  }
}

void PlyTextSource::end_record() {
  if (scanner_.next_in_line())
    scanner_.fail("expected the end of the line after the declared properties, found " + scanner_.quoted());
}

std::size_t PlyBinarySource::next(PlyType type) {
  if (left() < size_of(type))
    fail("expected another value of type " + std::string(to_string(type)) + ", found the end of the file");
  type_ = type;
  return at_;
}

double PlyBinarySource::number(const char* what) {
  const char* value_at = bytes_.data() + at_;
  const double value = type_ == PlyType::float64 ? std::bit_cast<double>(load_scalar<std::uint64_t>(value_at, order_))
                                                 : std::bit_cast<float>(load_scalar<std::uint32_t>(value_at, order_));
  if (!std::isfinite(value)) fail(std::string(what) + " is not a finite number");
  at_ += size_of(type_);
  return value;
}

std::int64_t PlyBinarySource::integer(const char*) {
  const char* value_at = bytes_.data() + at_;
  at_ += size_of(type_);
  switch (type_) {
    case PlyType::int8:
      return static_cast<std::int8_t>(load_scalar<std::uint8_t>(value_at, order_));
    case PlyType::uint8:
      return load_scalar<std::uint8_t>(value_at, order_);
    case PlyType::int16:
      return static_cast<std::int16_t>(load_scalar<std::uint16_t>(value_at, order_));
    case PlyType::uint16:
      return load_scalar<std::uint16_t>(value_at, order_);
    case PlyType::int32:
      return static_cast<std::int32_t>(load_scalar<std::uint32_t>(value_at, order_));
    case PlyType::uint32:
      return load_scalar<std::uint32_t>(value_at, order_);
    case PlyType::float32:
    case PlyType::float64:
      break;
  }
  throw Error(ErrorCode::internal, name_ + ": a property of type " + to_string(type_) + " was read as an integer");
}

void PlyBinarySource::skip(PlyType type, std::uint64_t count) {
  if (count > left() / size_of(type)) {
    fail(std::to_string(count) + " values of type " + to_string(type) + " do not fit into the " + std::to_string(left()) +
         " bytes that are left");
  }
  at_ += count * size_of(type);
}

void PlyBinarySource::fail_at(std::size_t position, const std::string& message) const {
  throw Error(ErrorCode::invalid_argument, name_ + ": byte " + std::to_string(position) + ": " + message);
}

}  // namespace deform::io
