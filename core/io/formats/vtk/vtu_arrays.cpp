// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/vtk/vtu_arrays.h"

#include <zlib.h>

#include <charconv>

#include "core/base/base64.h"
#include "core/base/error.h"
#include "core/io/binary/byte_order.h"
#include "core/io/text/text_scanner.h"

namespace deform::io {

namespace {

using Form = VtuArray::Form;
using ArrayKind = VtuArray::Kind;

struct TypeName {
  std::string_view name;
  ArrayKind kind;
  std::size_t bytes;
};
constexpr TypeName array_types[] = {
    {"Int8", ArrayKind::signed_integer, 1},  {"UInt8", ArrayKind::unsigned_integer, 1},
    {"Int16", ArrayKind::signed_integer, 2}, {"UInt16", ArrayKind::unsigned_integer, 2},
    {"Int32", ArrayKind::signed_integer, 4}, {"UInt32", ArrayKind::unsigned_integer, 4},
    {"Int64", ArrayKind::signed_integer, 8}, {"UInt64", ArrayKind::unsigned_integer, 8},
    {"Float32", ArrayKind::floating, 4},     {"Float64", ArrayKind::floating, 8},
};

std::string_view value_of(std::string_view bytes, const XmlNode& node, std::string_view attribute) {
  const XmlNode::Attribute* found = node.find(attribute);
  return found == nullptr ? std::string_view() : bytes.substr(found->begin, found->end - found->begin);
}

const TypeName* find_type(std::string_view name) {
  for (const TypeName& type : array_types) {
    if (type.name == name) return &type;
  }
  return nullptr;
}

std::string quoted_start(std::string_view text) { return std::string(1, '"').append(text.substr(0, 40)).append(1, '"'); }

std::uint64_t load_header(const char* at, const VtuStorage& storage) {
  return storage.header_bytes == 8 ? load_scalar<std::uint64_t>(at, storage.order)
                                   : load_scalar<std::uint32_t>(at, storage.order);
}

void append_header(std::string& out, std::uint64_t value, const VtuStorage& storage) {
  out.resize(out.size() + storage.header_bytes);
  char* at = out.data() + out.size() - storage.header_bytes;
  if (storage.header_bytes == 8) {
    store_scalar(at, value, storage.order);
  } else {
    store_scalar(at, static_cast<std::uint32_t>(value), storage.order);
  }
}

/// Reads one binary array. Base64 comes in one or two texts of which each is padded for itself.
class Decoder {
 public:
  Decoder(std::string_view bytes, const VtuStorage& storage, const VtuArray& array)
      : bytes_(bytes), storage_(storage), array_(array), text_(bytes.substr(array.begin, array.end - array.begin)) {
    if (array.form == Form::base64 && text_.find_first_of(" \t\r\n") != std::string_view::npos) {
      for (const char c : text_) {
        if (c != ' ' && c != '\t' && c != '\r' && c != '\n') compact_ += c;
      }
      text_ = compact_;
    }
  }

  VtuData read() {
    VtuData data;
    if (storage_.compressor.empty()) {
      read_plain(data);
    } else {
      read_blocks(data);
    }
    if (array_.form == Form::base64 && at_ != text_.size()) {
      fail(std::to_string(text_.size() - at_) + " characters too many behind its values");
    }
    data.end = array_.form == Form::base64 ? array_.end : array_.begin + at_;
    return data;
  }

 private:
  [[noreturn]] void fail(const std::string& message) const {
    fail_in_line(bytes_, storage_.name, array_.begin, array_.title + ": " + message);
  }

  bool raw() const { return array_.form == Form::appended_raw; }

  /// The bytes at the cursor, at least `count` of them (base64: up to the end of their groups), without moving it.
  std::string peek(std::uint64_t count) const {
    const std::uint64_t left = text_.size() - at_;
    if (count > left || (!raw() && base64_size(count) > left)) {
      fail("it claims " + std::to_string(count) + " bytes, only " + std::to_string(raw() ? left : left / 4 * 3) + " are left");
    }
    if (raw()) return std::string(text_.substr(at_, count));
    const auto bytes = base64_decoded(text_.substr(at_, base64_size(count)));
    if (!bytes) fail("its values are no base64");
    if (bytes->size() < count)
      fail("its base64 ends after " + std::to_string(bytes->size()) + " of " + std::to_string(count) + " bytes");
    return *bytes;
  }
  void advance(std::uint64_t count) { at_ += raw() ? count : base64_size(count); }

  void read_plain(VtuData& data) {
    const std::size_t h = storage_.header_bytes;
    const std::string head = peek(h);
    const std::uint64_t count = load_header(head.data(), storage_);
    if (count > text_.size())
      fail("it claims " + std::to_string(count) + " bytes, only " + std::to_string(text_.size()) + " are left");
    data.header_apart = !raw() && head.size() == h;
    if (raw() || data.header_apart) {
      advance(h);
      data.values = peek(count).substr(0, count);
      advance(count);
    } else {
      data.values = peek(h + count).substr(h, count);
      advance(h + count);
    }
  }

  /// Header: number of blocks, bytes of a block, bytes of the last one when it is smaller, then the packed size of every block.
  void read_blocks(VtuData& data) {
    if (storage_.compressor != "vtkZLibDataCompressor") {
      fail("compressor " + quoted_start(storage_.compressor) + " is not supported, only vtkZLibDataCompressor");
    }
    const std::size_t h = storage_.header_bytes;
    const std::uint64_t blocks = load_header(peek(h).data(), storage_);
    data.header_apart = true;
    if (blocks == 0) {  // some programs leave the two sizes out
      advance(text_.size() - at_ >= (raw() ? 3 * h : base64_size(3 * h)) ? 3 * h : h);
      return;
    }
    if (blocks > text_.size() / h) fail("it claims " + std::to_string(blocks) + " blocks, more than the file has bytes for");
    const std::uint64_t header_size = (3 + blocks) * h;
    const std::string header = peek(header_size);
    advance(header_size);
    data.block_bytes = load_header(header.data() + h, storage_);
    data.last_bytes = load_header(header.data() + 2 * h, storage_);
    std::uint64_t packed_size = 0;
    for (std::uint64_t b = 0; b < blocks; ++b) {
      const std::uint64_t size = load_header(header.data() + (3 + b) * h, storage_);
      if (size > text_.size() - at_ - packed_size)
        fail("block " + std::to_string(b) + " claims " + std::to_string(size) + " bytes, too many");
      packed_size += size;
    }
    const std::string packed = peek(packed_size);
    advance(packed_size);
    std::size_t from = 0;
    for (std::uint64_t b = 0; b < blocks; ++b) {
      const auto size = static_cast<std::size_t>(load_header(header.data() + (3 + b) * h, storage_));
      data.blocks.push_back(packed.substr(from, size));
      from += size;
      unpack(data.blocks.back(), b, b + 1 == blocks && data.last_bytes != 0 ? data.last_bytes : data.block_bytes, data.values);
    }
  }

  void unpack(const std::string& block, std::uint64_t number, std::uint64_t size, std::string& out) const {
    constexpr std::uint64_t most = 1032;  // deflate packs no better
    const std::string name = "block " + std::to_string(number);
    if (size / most > block.size() + 64)
      fail(name + " claims " + std::to_string(size) + " bytes from " + std::to_string(block.size()));
    const std::size_t first = out.size();
    out.resize(first + static_cast<std::size_t>(size));
    uLongf got = size;
    const int status = uncompress(reinterpret_cast<Bytef*>(out.data() + first), &got,
                                  reinterpret_cast<const Bytef*>(block.data()), block.size());
    if (status != Z_OK || got != size) fail(name + " is damaged: it is not zlib data of " + std::to_string(size) + " bytes");
  }

  const std::string_view bytes_;
  const VtuStorage& storage_;
  const VtuArray& array_;
  std::string compact_;
  std::string_view text_;
  std::size_t at_ = 0;
};

std::string packed(std::string_view bytes) {
  uLongf size = compressBound(bytes.size());
  std::string out(size, '\0');
  if (compress2(reinterpret_cast<Bytef*>(out.data()), &size, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size(),
                Z_DEFAULT_COMPRESSION) != Z_OK) {
    throw Error(ErrorCode::out_of_budget, "no memory for compression");
  }
  out.resize(size);
  return out;
}

std::int64_t load_integer(const char* at, const VtuArray& array, std::endian order) {
  const bool with_sign = array.kind == ArrayKind::signed_integer;
  switch (array.value_bytes) {
    case 1:
      return with_sign ? std::int64_t{static_cast<signed char>(*at)} : std::int64_t{static_cast<unsigned char>(*at)};
    case 2: {
      const auto value = load_scalar<std::uint16_t>(at, order);
      return with_sign ? std::int64_t{static_cast<std::int16_t>(value)} : std::int64_t{value};
    }
    case 4: {
      const auto value = load_scalar<std::uint32_t>(at, order);
      return with_sign ? std::int64_t{static_cast<std::int32_t>(value)} : std::int64_t{value};
    }
    default:
      return static_cast<std::int64_t>(load_scalar<std::uint64_t>(at, order));
  }
}

void read_appended(std::string_view bytes, const XmlNode& node, VtuStorage& storage) {
  const std::string_view encoding = value_of(bytes, node, "encoding");
  if (encoding != "raw" && encoding != "base64") {
    fail_in_line(bytes, storage.name, node.place,
                 "AppendedData with encoding " + quoted_start(encoding) + ", expected raw or base64");
  }
  std::size_t at = node.inner_begin;
  while (at < node.inner_end && bytes[at] != '_') ++at;
  if (at == node.inner_end) fail_in_line(bytes, storage.name, node.place, "AppendedData without the _ before its values");
  storage.appended = at + 1;
  storage.appended_end = node.inner_end;
  storage.appended_base64 = encoding == "base64";
}

}  // namespace

std::uint64_t count_attribute(std::string_view bytes, const std::string& name, const XmlNode& node, std::string_view attribute,
                              std::uint64_t fallback) {
  if (node.find(attribute) == nullptr) return fallback;
  std::string_view text = value_of(bytes, node, attribute);
  while (!text.empty() && text.front() == ' ') text.remove_prefix(1);
  while (!text.empty() && text.back() == ' ') text.remove_suffix(1);
  std::uint64_t value = 0;
  const auto [end, status] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (status != std::errc{} || end != text.data() + text.size()) {
    fail_in_line(bytes, name, node.place, std::string(attribute) + "=" + quoted_start(text) + ", expected a count");
  }
  return value;
}

VtuStorage read_storage(std::string_view bytes, const std::string& name, const XmlNode& root) {
  VtuStorage storage;
  storage.name = name;
  const std::string_view order = value_of(bytes, root, "byte_order"), header = value_of(bytes, root, "header_type");
  if (order == "BigEndian") {
    storage.order = std::endian::big;
  } else if (!order.empty() && order != "LittleEndian") {
    fail_in_line(bytes, name, root.place, "byte_order " + quoted_start(order) + ", expected LittleEndian or BigEndian");
  }
  if (header == "UInt64") {
    storage.header_bytes = 8;
  } else if (!header.empty() && header != "UInt32") {
    fail_in_line(bytes, name, root.place, "header_type " + quoted_start(header) + ", expected UInt32 or UInt64");
  }
  storage.compressor = value_of(bytes, root, "compressor");
  if (const XmlNode* appended = root.child("AppendedData")) read_appended(bytes, *appended, storage);
  return storage;
}

bool is_numeric(std::string_view bytes, const XmlNode& node) {
  return node.name == "DataArray" && find_type(value_of(bytes, node, "type")) != nullptr;
}

VtuArray find_array(std::string_view bytes, const VtuStorage& storage, const XmlNode& node) {
  VtuArray array;
  array.title = "DataArray " + quoted_start(xml_text(value_of(bytes, node, "Name")));
  const auto fail = [&](const std::string& message) {
    fail_in_line(bytes, storage.name, node.place, array.title + ": " + message);
  };
  const TypeName* type = find_type(value_of(bytes, node, "type"));
  if (type == nullptr) fail("unknown type " + quoted_start(value_of(bytes, node, "type")));
  array.kind = type->kind;
  array.value_bytes = type->bytes;
  array.components = count_attribute(bytes, storage.name, node, "NumberOfComponents", 1);
  array.begin = node.text_begin;
  array.end = node.text_end;
  const std::string_view format = value_of(bytes, node, "format");
  if (format == "ascii") {
    array.form = Form::ascii;
  } else if (format == "binary") {
    array.form = Form::base64;
  } else if (format == "appended") {
    if (storage.appended == 0) fail("its values are appended, but there is no AppendedData");
    if (node.find("offset") == nullptr) fail("its values are appended, but it has no offset");
    const std::uint64_t offset = count_attribute(bytes, storage.name, node, "offset", 0);
    if (offset > storage.appended_end - storage.appended) {
      fail("offset " + std::to_string(offset) + ", there are only " + std::to_string(storage.appended_end - storage.appended) +
           " bytes of appended data");
    }
    array.form = storage.appended_base64 ? Form::appended_base64 : Form::appended_raw;
    array.begin = storage.appended + static_cast<std::size_t>(offset);
    array.end = storage.appended_end;
  } else {
    fail("format " + quoted_start(format) + ", expected ascii, binary or appended");
  }
  return array;
}

VtuData decoded(std::string_view bytes, const VtuStorage& storage, const VtuArray& array) {
  return Decoder(bytes, storage, array).read();
}

std::vector<std::int64_t> integers(std::string_view bytes, const VtuStorage& storage, VtuArray& array) {
  std::vector<std::int64_t> values;
  if (array.kind == ArrayKind::floating) fail_in_line(bytes, storage.name, array.begin, array.title + ": expected integers");
  if (array.form == Form::ascii) {
    TextScanner scanner(bytes.substr(0, array.end), storage.name, Syntax::plain);
    scanner.move_to(array.begin);
    while (scanner.next_in_file()) values.push_back(scanner.whole_integer("an integer"));
    return values;
  }
  if (array.begin == array.end) return values;
  const VtuData data = decoded(bytes, storage, array);
  const std::string& raw = data.values;
  array.end = data.end;
  if (raw.size() % array.value_bytes != 0) {
    fail_in_line(bytes, storage.name, array.begin,
                 array.title + ": " + std::to_string(raw.size()) + " bytes are no whole number of values");
  }
  values.reserve(raw.size() / array.value_bytes);
  for (std::size_t at = 0; at < raw.size(); at += array.value_bytes) {
    values.push_back(load_integer(raw.data() + at, array, storage.order));
  }
  return values;
}

std::string encoded(const VtuStorage& storage, const VtuArray& array, const VtuData& old, std::string_view values) {
  const auto in_form = [&](std::string_view bytes) {
    return array.form == Form::appended_raw ? std::string(bytes) : base64_encoded(bytes);
  };
  std::string header;
  if (old.blocks.empty()) {
    append_header(header, values.size(), storage);
    return old.header_apart ? in_form(header) + in_form(values) : in_form(header + std::string(values));
  }
  append_header(header, old.blocks.size(), storage);
  append_header(header, old.block_bytes, storage);
  append_header(header, old.last_bytes, storage);
  std::string blocks;
  const auto block_bytes = static_cast<std::size_t>(old.block_bytes);
  for (std::size_t b = 0; b < old.blocks.size(); ++b) {
    // The last block ends with the values: damaged headers call it larger than the others.
    const std::size_t length = b + 1 == old.blocks.size() ? std::string_view::npos : block_bytes;
    const std::string_view now = values.substr(b * block_bytes, length);
    const bool same = now == std::string_view(old.values).substr(b * block_bytes, length);
    const std::string block = same ? old.blocks[b] : packed(now);
    append_header(header, block.size(), storage);
    blocks += block;
  }
  return in_form(header) + in_form(blocks);
}

}  // namespace deform::io
