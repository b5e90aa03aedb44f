// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/held_requests.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/wire_format_lite.h>
#include <grpcpp/support/proto_buffer_reader.h>

#include <map>
#include <mutex>
#include <string>
#include <unordered_map>
#include <utility>

#include "core/base/error.h"
#include "server/engine/memory.h"

namespace deform::server {

namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::internal::WireFormatLite;
using google::protobuf::io::CodedInputStream;

// Of protobuf's C++ library.
constexpr std::size_t allocation_bytes = 16;     ///< of the allocator, for each piece
constexpr std::size_t pointer_bytes = 16;        ///< in an array that doubles
constexpr std::size_t string_bytes = 32;         ///< without its characters
constexpr std::size_t unknown_field_bytes = 64;  ///< a field that is not in the contract is kept
constexpr std::size_t small_request = 64 << 10;  ///< may use all of the limit
constexpr std::size_t share_of_small = 8;        ///< of the limit, by which larger ones stay below it
constexpr std::uint32_t held_retry_ms = 200;

/// What is known of a message type: its own size, and its fields by number.
struct Type {
  struct Field {
    const Type* message = nullptr;
    bool characters = false;  ///< string or bytes
    bool repeated = false;
    std::size_t number_size = 8;  ///< of one that is packed
    bool varint = false;
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
    const auto wire = WireFormatLite::WireTypeForFieldType(static_cast<WireFormatLite::FieldType>(field.type()));
    out.varint = wire == WireFormatLite::WIRETYPE_VARINT;
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
      if (!(found != type.fields.end() ? add_field(found->second, tag, depth) : add_unknown(tag))) return false;
    }
  }
  std::size_t total() const { return total_; }

 private:
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
      total_ += field.varint ? 2 * field.number_size * bytes : bytes;  // a number may be one byte
    }
    return in_.Skip(length);
  }

  bool add_unknown(std::uint32_t tag) {
    const int before = in_.CurrentPosition();
    const bool good = WireFormatLite::SkipField(&in_, tag);
    total_ += unknown_field_bytes + static_cast<std::size_t>(in_.CurrentPosition() - before);
    return good;
  }

  CodedInputStream& in_;
  const std::size_t enough_;
  std::size_t total_ = 0;
};

}  // namespace

std::size_t parsed_size(const grpc::ByteBuffer& bytes, const Descriptor& descriptor, std::size_t enough) {
  grpc::ByteBuffer copy(bytes);  // counts references only; the reader wants a mutable buffer
  grpc::ProtoBufferReader reader(&copy);
  if (!reader.status().ok()) return 0;
  CodedInputStream in(&reader);
  Adder adder(in, enough);
  adder.add(known_type(descriptor), 0);
  return adder.total();
}

struct HeldRequests::Meter {
  std::size_t limit = 0;
  std::mutex mutex;
  std::size_t in_use = 0;  // under mutex
};

HeldRequests::HeldRequests(std::size_t limit) : meter_(std::make_shared<Meter>()) { meter_->limit = limit; }

HeldRequests::Held::Held(Held&& other) noexcept
    : meter_(std::exchange(other.meter_, nullptr)), bytes_(std::exchange(other.bytes_, 0)) {}

HeldRequests::Held& HeldRequests::Held::operator=(Held&& other) noexcept {
  std::swap(meter_, other.meter_);
  std::swap(bytes_, other.bytes_);
  return *this;
}

HeldRequests::Held::~Held() {
  if (!meter_) return;
  {
    const std::lock_guard lock(meter_->mutex);
    meter_->in_use -= bytes_;
  }
  return_freed_memory(bytes_);
}

HeldRequests::Held HeldRequests::take(const grpc::ByteBuffer& bytes, const Descriptor& type) {
  const std::size_t parsed = parsed_size(bytes, type, largest_parsed_message);
  if (parsed > largest_parsed_message) {
    throw Error(ErrorCode::invalid_argument, "the " + std::to_string(bytes.Length()) + " bytes received are a " +
                                                 type.full_name() + " of so many parts that it would take more than " +
                                                 std::to_string(largest_parsed_message) + " bytes of memory");
  }
  return take(bytes.Length() + parsed);
}

HeldRequests::Held HeldRequests::take(std::size_t bytes) {
  const std::size_t limit = meter_->limit;
  const std::size_t allowed = bytes <= small_request ? limit : limit - limit / share_of_small;
  if (limit != 0 && bytes > allowed) {
    throw Error(ErrorCode::out_of_budget, "this request takes " + std::to_string(bytes) +
                                              " bytes of memory, all requests together may take " + std::to_string(allowed) +
                                              " (an eighth of --memory-budget): send it in parts");
  }
  const std::lock_guard lock(meter_->mutex);
  if (limit != 0 && meter_->in_use + bytes > allowed) {
    throw Error(ErrorCode::out_of_budget,
                "requests of " + std::to_string(meter_->in_use) + " bytes are held in memory, this one of " +
                    std::to_string(bytes) + " would exceed the limit of " + std::to_string(allowed) + ", try again later",
                held_retry_ms);
  }
  meter_->in_use += bytes;
  return {meter_, bytes};
}

std::size_t HeldRequests::in_use() const {
  const std::lock_guard lock(meter_->mutex);
  return meter_->in_use;
}

}  // namespace deform::server
