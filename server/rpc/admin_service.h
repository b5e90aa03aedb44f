// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <grpcpp/impl/service_type.h>

#include <functional>
#include <memory>

#include "deform/v1/admin.pb.h"
#include "server/engine/engine.h"
#include "server/rpc/reactors.h"

namespace deform::server {

/// What the operator does to the server around the engine. Called by any thread.
struct AdminActions {
  std::function<void()> drain, undrain;                   ///< may throw
  std::function<v1::ListConnectionsReply()> connections;  ///< without what is known of their calls
  std::function<v1::ListLimitsReply()> limits;
  std::function<v1::SetLimitReply(const v1::SetLimitRequest&)> set_limit;  ///< may throw
};

/// The gRPC service deform.v1.Admin (proto/deform/v1/admin.proto). It has threads of its own, so that it answers while every
/// other one is busy. Every act is logged with whoever asked for it.
class AdminService {
 public:
  using Admit = std::function<Incoming(grpc::CallbackServerContext*, const grpc::ByteBuffer*)>;

  /// All must outlive it; `admit` says that the role operator is needed.
  AdminService(Engine& engine, OpenCalls& calls, Admit admit);
  ~AdminService();

  grpc::Service& grpc_service();
  /// Before the first call.
  void set_actions(AdminActions actions);

 private:
  class Methods;
  std::unique_ptr<Methods> methods_;
};

}  // namespace deform::server
