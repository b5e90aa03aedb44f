// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/held_requests.h"

#include <google/protobuf/descriptor.h>
#include <grpcpp/support/proto_buffer_reader.h>

#include <mutex>
#include <string>
#include <utility>

#include "core/base/error.h"
#include "proto/convert/base/parsed_size.h"

namespace deform::server {

namespace {

constexpr std::size_t small_request = 64 << 10;  ///< may use all of the limit
constexpr std::size_t share_of_small = 8;        ///< of the limit, by which larger ones stay below it
constexpr std::uint32_t held_retry_ms = 200;

}  // namespace

std::size_t parsed_size(const grpc::ByteBuffer& bytes, const google::protobuf::Descriptor& type, std::size_t enough) {
  grpc::ByteBuffer copy(bytes);  // counts references only; the reader wants a mutable buffer
  grpc::ProtoBufferReader reader(&copy);
  return reader.status().ok() ? convert::parsed_size(reader, type, enough) : 0;
}

struct HeldRequests::Meter {
  std::size_t limit = 0;
  std::mutex mutex;
  std::size_t in_use = 0;  // under mutex
};

HeldRequests::HeldRequests(std::size_t limit) : meter_(std::make_shared<Meter>()) { meter_->limit = limit; }

HeldRequests::Held::Held(Held&& other) noexcept
    : meter_(std::exchange(other.meter_, nullptr)),
      of_tenant_(std::exchange(other.of_tenant_, nullptr)),
      bytes_(std::exchange(other.bytes_, 0)) {}

HeldRequests::Held& HeldRequests::Held::operator=(Held&& other) noexcept {
  std::swap(meter_, other.meter_);
  std::swap(of_tenant_, other.of_tenant_);
  std::swap(bytes_, other.bytes_);
  return *this;
}

HeldRequests::Held::~Held() {
  if (!meter_) return;
  {
    const std::lock_guard lock(meter_->mutex);
    meter_->in_use -= bytes_;
  }
  if (of_tenant_) of_tenant_->give_back(bytes_);
  return_freed_memory(bytes_);
}

HeldRequests::Held HeldRequests::take(const grpc::ByteBuffer& bytes, const google::protobuf::Descriptor& type,
                                      const TenantShare& share) {
  const std::size_t parsed = parsed_size(bytes, type, largest_parsed_message);
  if (parsed > largest_parsed_message) {
    throw Error(ErrorCode::invalid_argument, "the " + std::to_string(bytes.Length()) + " bytes received are a " +
                                                 type.full_name() + " of so many parts that it would take more than " +
                                                 std::to_string(largest_parsed_message) + " bytes of memory");
  }
  return take(bytes.Length() + parsed, share);
}

HeldRequests::Held HeldRequests::take(std::size_t bytes, const TenantShare& share) {
  const std::size_t limit = meter_->limit;
  const std::size_t allowed = bytes <= small_request ? limit : limit - limit / share_of_small;
  if (limit != 0 && bytes > allowed) {
    throw Error(ErrorCode::out_of_budget, "this request takes " + std::to_string(bytes) +
                                              " bytes of memory, all requests together may take " + std::to_string(allowed) +
                                              " (an eighth of --memory-budget): send it in parts")
        .refused_for(Refusal::held);
  }
  const std::lock_guard lock(meter_->mutex);
  if (limit != 0 && meter_->in_use + bytes > allowed) {
    throw Error(ErrorCode::out_of_budget,
                "requests and answers of " + std::to_string(meter_->in_use) + " bytes are held in memory, this one of " +
                    std::to_string(bytes) + " would exceed the limit of " + std::to_string(allowed) + ", try again later",
                held_retry_ms)
        .refused_for(Refusal::held);
  }
  if (share.meter) share.take(bytes, "this request");
  meter_->in_use += bytes;
  return {meter_, share.meter, bytes};
}

std::size_t HeldRequests::in_use() const {
  const std::lock_guard lock(meter_->mutex);
  return meter_->in_use;
}

}  // namespace deform::server
