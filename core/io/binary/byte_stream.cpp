// SPDX-License-Identifier: Apache-2.0
#include "core/io/binary/byte_stream.h"

#include "core/base/error.h"

namespace deform::io {

void ByteWriter::put(std::string_view bytes) {
  constexpr std::size_t enough = 1 << 16;
  if (pending_.size() + bytes.size() < enough) {
    pending_ += bytes;
    return;
  }
  flush();
  sink_(bytes);
}

void ByteWriter::flush() {
  if (!pending_.empty()) sink_(pending_);
  pending_.clear();
}

std::uint64_t ByteReader::number() {
  std::uint64_t value = 0;
  fill(reinterpret_cast<char*>(&value), sizeof(value));
  return value;
}

void ByteReader::fill(char* to, std::size_t size) {
  if (size > left_) refuse(size);
  left_ -= size;
  while (size > 0) {
    const std::size_t got = source_(to, size);
    if (got == 0) throw Error(ErrorCode::data_loss, "the bytes end early");
    to += got;
    size -= got;
  }
}

void ByteReader::refuse(std::uint64_t count) {
  throw Error(ErrorCode::data_loss, "a list of " + std::to_string(count) + " entries is longer than it may be");
}

}  // namespace deform::io
