// SPDX-License-Identifier: Apache-2.0
#include "proto/convert/base/parsed_size.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/message.h>
#include <google/protobuf/wire_format_lite.h>

#include <map>
#include <memory>
#include <mutex>
#include <unordered_map>

namespace deform::convert {

namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::internal::WireFormatLite;
using google::protobuf::io::CodedInputStream;

// Sizes of protobuf's C++ library.
constexpr std::size_t allocation_bytes = 16;  ///< of the allocator, for each piece
constexpr std::size_t pointer_bytes = 16;     ///< in an array that doubles
constexpr std::size_t string_bytes = 32;      ///< without its characters
/// A field that is not in the contract is kept: a place in an array that doubles, a string of room for 30 characters, and the set
/// of such fields, which the first one makes.
constexpr std::size_t unknown_field_bytes = 128;

/// What is known of a message type: its own size, and its fields by number.
struct Type {
  struct Field {
    const Type* message = nullptr;
    WireFormatLite::WireType wire{};  ///< of one value
    bool characters = false;          ///< string or bytes
    bool repeated = false;
    std::size_t number_size = 8;
  };
  std::size_t size = 0;
  std::unordered_map<int, Field> fields;
};

/// Built once per type, never freed. Thread-safe.
const Type& known_type(const Descriptor& descriptor) {
  static std::recursive_mutex mutex;
  static auto& types = *new std::map<const Descriptor*, std::unique_ptr<Type>>;
  const std::lock_guard lock(mutex);
  std::unique_ptr<Type>& known = types[&descriptor];
  if (known) return *known;
  known = std::make_unique<Type>();
  Type& type = *known;
  type.size =
      google::protobuf::MessageFactory::generated_factory()->GetPrototype(&descriptor)->SpaceUsedLong() + allocation_bytes;
  for (int i = 0; i < descriptor.field_count(); ++i) {
    const FieldDescriptor& field = *descriptor.field(i);
    Type::Field& out = type.fields[field.number()];
    out.repeated = field.is_repeated();
    out.characters = field.cpp_type() == FieldDescriptor::CPPTYPE_STRING;
    out.wire = WireFormatLite::WireTypeForFieldType(static_cast<WireFormatLite::FieldType>(field.type()));
    const auto cpp = field.cpp_type();
    const bool wide =
        cpp == FieldDescriptor::CPPTYPE_INT64 || cpp == FieldDescriptor::CPPTYPE_UINT64 || cpp == FieldDescriptor::CPPTYPE_DOUBLE;
    out.number_size = cpp == FieldDescriptor::CPPTYPE_BOOL ? 1 : wide ? 8 : 4;
    if (cpp == FieldDescriptor::CPPTYPE_MESSAGE) out.message = &known_type(*field.message_type());
  }
  return type;
}

/// Adds up the message whose fields the stream shows.
class Adder {
 public:
  Adder(CodedInputStream& in, std::size_t enough) : in_(in), enough_(enough) {}

  /// False when it is enough or no message.
  bool add(const Type& type, int depth) {
    total_ += type.size;
    for (;;) {
      if (total_ > enough_) return false;
      const std::uint32_t tag = in_.ReadTag();
      if (tag == 0) return true;
      const auto found = type.fields.find(WireFormatLite::GetTagFieldNumber(tag));
      const bool known = found != type.fields.end() && fits(found->second, WireFormatLite::GetTagWireType(tag));
      if (!(known ? add_field(found->second, tag, depth) : add_unknown(tag))) return false;
    }
  }
  std::size_t total() const { return total_; }

 private:
  /// Else the parser takes the field for one that is not in the contract. Numbers that are repeated may be packed.
  static bool fits(const Type::Field& field, WireFormatLite::WireType wire) {
    return wire == field.wire || (field.repeated && wire == WireFormatLite::WIRETYPE_LENGTH_DELIMITED);
  }

  bool add_field(const Type::Field& field, std::uint32_t tag, int depth) {
    if (WireFormatLite::GetTagWireType(tag) != WireFormatLite::WIRETYPE_LENGTH_DELIMITED) {
      if (field.repeated) total_ += 2 * field.number_size;  // in an array that doubles
      return WireFormatLite::SkipField(&in_, tag);
    }
    int length = 0;
    if (!in_.ReadVarintSizeAsInt(&length)) return false;
    if (field.repeated) total_ += pointer_bytes;
    if (field.message != nullptr) {
      if (depth >= 100) return false;  // the parser refuses it
      const auto limit = in_.PushLimit(length);
      const bool good = add(*field.message, depth + 1);
      in_.PopLimit(limit);
      return good;
    }
    const auto bytes = static_cast<std::size_t>(length);
    if (field.characters) {
      total_ += string_bytes + bytes + allocation_bytes;
    } else {
      total_ +=
          field.wire == WireFormatLite::WIRETYPE_VARINT ? 2 * field.number_size * bytes : bytes;  // a number may be one byte
    }
    return in_.Skip(length);
  }

  bool add_unknown(std::uint32_t tag) {
    const int before = in_.CurrentPosition();
    const bool good = WireFormatLite::SkipField(&in_, tag);
    const auto bytes = static_cast<std::size_t>(in_.CurrentPosition() - before);
    const bool group = WireFormatLite::GetTagWireType(tag) == WireFormatLite::WIRETYPE_START_GROUP;
    total_ += unknown_field_bytes + (group ? unknown_field_bytes / 2 : 1) * bytes;  // a field in a group may be two bytes
    return good;
  }

  CodedInputStream& in_;
  const std::size_t enough_;
  std::size_t total_ = 0;
};

}  // namespace

std::size_t parsed_size(google::protobuf::io::ZeroCopyInputStream& bytes, const Descriptor& type, std::size_t enough) {
  CodedInputStream in(&bytes);
  Adder adder(in, enough);
  adder.add(known_type(type), 0);
  return adder.total();
}

}  // namespace deform::convert
