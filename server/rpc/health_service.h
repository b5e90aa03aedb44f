// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <grpcpp/impl/service_type.h>

#include <memory>
#include <string>

#include "server/rpc/flood_guard.h"
#include "server/rpc/peers.h"
#include "server/rpc/reactors.h"

namespace deform::server {

/// The gRPC service grpc.health.v1.Health (proto/grpc/health/v1/health.proto), open to everybody. Unlike the one that gRPC
/// brings, it counts the calls that stay open (Watch) with all others, by the host of the client, and notices those that are
/// begun and reset without end. It answers in gRPC's threads and never blocks. Thread-safe.
class HealthService {
 public:
  /// All must outlive it.
  HealthService(LiveCalls& live, FloodGuard& floods, const TrustedProxies& proxies);
  ~HealthService();

  grpc::Service& grpc_service();
  /// A service that was never set is unknown; "" is the server as a whole.
  void set_serving(const std::string& service, bool serving);
  /// Ends each Watch when its client has the status of now, and new ones as soon; they would last as long as the server.
  void end_watches();

 private:
  class Methods;
  std::unique_ptr<Methods> methods_;
};

}  // namespace deform::server
