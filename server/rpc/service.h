// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "server/engine/engine.h"
#include "server/rpc/access.h"
#include "server/rpc/admin_service.h"
#include "server/rpc/health_service.h"
#include "server/rpc/metrics.h"
#include "server/rpc/peers.h"
#include "server/rpc/streams/service_requests.h"

namespace grpc {
class Service;
}

namespace deform::server {

/// Limits of the transport side; those of the content are the engine's.
struct ServiceOptions {
  StreamLimits stream;
  std::chrono::milliseconds max_deadline{0};  ///< of a call, or of a request of a DeformStream; 0: none but the client's
  /// That a call waits for its client to send what is missing, or to take what was sent; 0: for ever.
  std::chrono::milliseconds stall_timeout{600'000};
  Access::Options access;     ///< who may call
  TrustedProxies proxies;     ///< whose word is taken for who calls through them
  std::size_t max_calls = 0;  ///< open at once; 0: as many as take an eighth of the memory budget
  int call_threads = 8;       ///< for calls that wait for the disk: so many for questions, and as many for meshes and setups
  std::size_t waiting_calls = 1024;                     ///< of those; more are refused with a retry hint
  std::size_t max_setup_bytes = std::size_t{64} << 20;  ///< of a setup that comes in pieces

  /// Throws Error(invalid_argument) naming the option and its limits.
  void validate() const;
};

/// The gRPC service around an engine: converts, and nothing else. The contract is in proto/deform/v1.
class DeformService {
 public:
  /// The engine must outlive the service, the service the server it is registered with.
  DeformService(Engine& engine, const ServiceOptions& options);
  ~DeformService();

  /// To register with a server builder: the service, and the one for the operator.
  grpc::Service& grpc_service();
  grpc::Service& admin_service();
  /// The health of all services, to register as well.
  HealthService& health();
  /// What that one does to the server around. Before the first call.
  void set_admin_actions(AdminActions actions);

  /// Ends every DeformStream as soon as its open requests are answered, and new ones at once. Does not wait.
  void drain();
  /// While it is so, calls that compute or add are refused with UNAVAILABLE, and DeformStreams end as above; what is under way
  /// goes on. Any thread.
  void set_draining(bool draining);
  /// The limit of the time of calls that begin later; 0: none. Any thread.
  void set_max_deadline(std::chrono::milliseconds limit);
  /// Ends calls that wait for their clients for longer than ServiceOptions::stall_timeout. Any thread; called every second.
  void end_stalled_calls();
  /// While it is so, calls that compute or add are refused with a retry hint; what is under way goes on. Any thread.
  void set_memory_full(bool full);
  bool memory_full() const;
  /// Memory of requests and answers that are held.
  std::size_t held_request_bytes() const;
  /// What happens to a connection that begins calls and resets them without end. Before the first call.
  void on_flood(std::function<void(const std::string& peer)> action);
  /// The metrics of all calls.
  const Metrics& metrics() const;
  /// Rereads the files of who may call when they changed. Now and then, by anyone.
  void refresh_access();
  /// Waits until no call is left; false when the time is over first.
  bool wait_for_none(std::chrono::steady_clock::time_point deadline);

 private:
  class Methods;
  std::unique_ptr<Methods> methods_;
};

}  // namespace deform::server
