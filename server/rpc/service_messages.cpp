// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/service_messages.h"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>
#include <google/protobuf/wire_format_lite.h>
#include <grpcpp/support/proto_buffer_reader.h>
#include <grpcpp/support/slice.h>

#include <bit>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"

namespace deform::server {

namespace {

using google::protobuf::internal::WireFormatLite;
using google::protobuf::io::CodedOutputStream;
using google::protobuf::io::StringOutputStream;

static_assert(std::endian::native == std::endian::little, "points are sent as they lie in memory");

/// Tag and length of a length-delimited field.
std::string field_head(int number, std::size_t length) {
  std::string out;
  StringOutputStream stream(&out);
  CodedOutputStream coded(&stream);
  coded.WriteTag(WireFormatLite::MakeTag(number, WireFormatLite::WIRETYPE_LENGTH_DELIMITED));
  coded.WriteVarint64(length);
  coded.Trim();
  return out;
}

/// A slice that owns `keep` and shows [data, data + size) of what it owns.
template <typename T>
grpc::Slice owning_slice(T keep, const void* data, std::size_t size) {
  auto* owner = new T(std::move(keep));
  return grpc::Slice(
      const_cast<void*>(data), size, [](void* p) { delete static_cast<T*>(p); }, owner);
}

Error no_message(const grpc::ByteBuffer& bytes, const google::protobuf::Message& message) {
  return {ErrorCode::invalid_argument, "the " + std::to_string(bytes.Length()) + " bytes received are not a " +
                                           message.GetDescriptor()->full_name() +
                                           " (damaged, nested deeper than 100, or text that is not UTF-8)"};
}

}  // namespace

void parse(const grpc::ByteBuffer& bytes, google::protobuf::Message& message) {
  grpc::ByteBuffer copy(bytes);  // counts references only; the reader wants a mutable buffer
  grpc::ProtoBufferReader reader(&copy);
  if (!reader.status().ok() || !message.ParseFromZeroCopyStream(&reader)) throw no_message(bytes, message);
}

v1::DeformStreamRequest without_request(const grpc::ByteBuffer& bytes) {
  v1::DeformStreamRequest out;
  grpc::ByteBuffer copy(bytes);
  grpc::ProtoBufferReader reader(&copy);
  if (!reader.status().ok()) throw no_message(bytes, out);
  google::protobuf::io::CodedInputStream in(&reader);
  for (std::uint32_t tag = in.ReadTag(); tag != 0; tag = in.ReadTag()) {
    std::uint64_t number = 0;
    const bool is_number = WireFormatLite::GetTagWireType(tag) == WireFormatLite::WIRETYPE_VARINT;
    if (!(is_number ? in.ReadVarint64(&number) : WireFormatLite::SkipField(&in, tag))) throw no_message(bytes, out);
    if (!is_number) continue;
    const int field = WireFormatLite::GetTagFieldNumber(tag);
    if (field == v1::DeformStreamRequest::kRequestIdFieldNumber) out.set_request_id(number);
    if (field == v1::DeformStreamRequest::kMoreFieldNumber) out.set_more(number != 0);
    if (field == v1::DeformStreamRequest::kCancelFieldNumber) out.set_cancel(number != 0);
  }
  return out;
}

grpc::ByteBuffer serialized(const google::protobuf::Message& message) {
  grpc::Slice slice(message.ByteSizeLong());
  // begin() is const only because slices are shared; nobody else knows this one yet.
  message.SerializeWithCachedSizesToArray(const_cast<std::uint8_t*>(slice.begin()));
  return grpc::ByteBuffer(&slice, 1);
}

grpc::ByteBuffer serialized(v1::DeformReply&& reply) {
  if (!reply.has_block()) return serialized(static_cast<const google::protobuf::Message&>(reply));
  v1::Block& block = *reply.mutable_block();
  auto data = std::make_unique<std::string>(std::move(*block.mutable_data()));
  block.clear_data();
  const std::size_t data_size = data->size();

  // data is the last field of Block and block the last field set in the reply, so the two heads nest in front of the bytes.
  const std::string rest_of_block = block.SerializeAsString();
  const std::string data_head = data_size == 0 ? std::string() : field_head(v1::Block::kDataFieldNumber, data_size);
  v1::DeformReply outer;
  outer.set_request_id(reply.request_id());
  const std::string head = outer.SerializeAsString() +
                           field_head(v1::DeformReply::kBlockFieldNumber, rest_of_block.size() + data_head.size() + data_size) +
                           rest_of_block + data_head;
  if (data_size == 0) {
    const grpc::Slice slice(head);
    return grpc::ByteBuffer(&slice, 1);
  }
  const char* bytes = data->data();
  const grpc::Slice slices[] = {grpc::Slice(head), owning_slice(std::move(data), bytes, data_size)};
  return grpc::ByteBuffer(slices, 2);
}

grpc::ByteBuffer serialized_chunk(const std::shared_ptr<const Points>& points, std::size_t begin, std::size_t end) {
  const std::size_t size = (end - begin) * sizeof(Vec3);
  const grpc::Slice slices[] = {grpc::Slice(field_head(v1::PointChunk::kXyzFieldNumber, size)),
                                owning_slice(points, points->data() + begin, size)};
  return grpc::ByteBuffer(slices, 2);
}

}  // namespace deform::server
