// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <grpcpp/support/byte_buffer.h>

#include <memory>

#include "core/base/types.h"
#include "deform/v1/service.pb.h"

namespace deform::server {

/// The service reads and writes bytes itself instead of through gRPC's generated wrappers, because those answer bytes that are no
/// message with UNIMPLEMENTED or take them for the end of the stream, and copy every block twice. On the wire nothing differs.

/// Throws Error(invalid_argument) when the bytes are not a `message`.
void parse(const grpc::ByteBuffer& bytes, google::protobuf::Message& message);

/// The same, of which everything but the request itself is read: for one that there is no room for.
v1::DeformStreamRequest without_request(const grpc::ByteBuffer& bytes);

grpc::ByteBuffer serialized(const google::protobuf::Message& message);

/// Block data moves into the buffer without being copied.
grpc::ByteBuffer serialized(v1::DeformReply&& reply);

/// The PointChunk of points [begin, end): refers to the points, which stay alive as long as the buffer does.
grpc::ByteBuffer serialized_chunk(const std::shared_ptr<const Points>& points, std::size_t begin, std::size_t end);

}  // namespace deform::server
