// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <google/protobuf/message.h>
#include <grpcpp/support/byte_buffer.h>

#include <atomic>
#include <cstddef>
#include <memory>

#include "server/engine/memory.h"

namespace deform::server {

/// What one message may take once it is parsed: several times what the largest that mean something take.
inline constexpr std::size_t largest_parsed_message = std::size_t{64} << 20;

/// convert::parsed_size() of bytes as gRPC has them.
std::size_t parsed_size(const grpc::ByteBuffer& bytes, const google::protobuf::Descriptor& type, std::size_t enough);

/// Requests in memory, as bytes and parsed, are charged before they are parsed. Large ones leave room for small ones, so that who
/// asks for little is answered while others hold much. Thread-safe.
class HeldRequests {
  struct Meter;

 public:
  /// 0: no limit.
  explicit HeldRequests(std::size_t limit);

  /// A share, given back at its end, which may come after that of HeldRequests. Movable; one owner at a time.
  class Held {
   public:
    Held() = default;
    Held(Held&& other) noexcept;
    Held& operator=(Held&& other) noexcept;
    ~Held();
    std::size_t bytes() const { return bytes_; }

   private:
    friend class HeldRequests;
    Held(std::shared_ptr<Meter> meter, std::shared_ptr<MemoryMeter> of_tenant, std::size_t bytes)
        : meter_(std::move(meter)), of_tenant_(std::move(of_tenant)), bytes_(bytes) {}
    std::shared_ptr<Meter> meter_;
    std::shared_ptr<MemoryMeter> of_tenant_;  // may be null
    std::size_t bytes_ = 0;
  };

  /// Takes what these bytes and their message need. Throws Error(invalid_argument) for a message beyond largest_parsed_message,
  /// and Error(out_of_budget) with a retry hint when there is no room now, or
  /// no share of their tenant is left.
  Held take(const grpc::ByteBuffer& bytes, const google::protobuf::Descriptor& type, const TenantShare& share = {});
  /// The same for bytes that are known.
  Held take(std::size_t bytes, const TenantShare& share = {});

  std::size_t in_use() const;

 private:
  std::shared_ptr<Meter> meter_;
};

}  // namespace deform::server
